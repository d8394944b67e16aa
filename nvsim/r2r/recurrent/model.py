"""The network: an encoder of the instruction, and the step that attends to candidates and updates the state.

Source of the idea: Hong et al. 2021, VLN↻BERT (section 3). The state is a token that attends to words and candidates.
Its attention to the candidates is the action, and the attended tokens refine the state. This implementation is new and
small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from nvsim.r2r.recurrent.config import ModelConfig

MOVED = 6
"""Size of the feature of the last move: see `AgentInput.moved`."""
FAR = 5.0
"""Meters by which distances are divided in the features."""


class AgentInput(NamedTuple):
    """The input of a batch of agents at their viewpoints. Slot 0 of the candidates is stopping.

    views      (B, K, F) features of the candidates, zeros in slot 0
    angles     (B, K, angle_size) angle features of the candidates, relative to the agent's heading
    distance   (B, K) meters
    open       (B, K) bool, which slots exist
    moved      (B, MOVED) the last move: sin and cos of the turn, sin of the slope, meters / 5, all 0 at the start; 1 at
               the start; meters / 5 since the last turn
    around     (B, 36, F) features of all views, or None if they are not shown
    around_angles  (B, 36, angle_size) their angle features, or None
    """

    views: Tensor
    angles: Tensor
    distance: Tensor
    open: Tensor
    moved: Tensor
    around: Tensor | None = None
    around_angles: Tensor | None = None


class EncodedInstruction(NamedTuple):
    """An encoded instruction, with keys and values for each layer of the step.

    tokens   (B, L, D)
    known    (B, L) bool, which tokens are words and not padding
    keys, values   of each layer (B, heads, L, D / heads)
    """

    tokens: Tensor
    known: Tensor
    keys: list[Tensor]
    values: list[Tensor]

    def of(self, kept: Tensor) -> EncodedInstruction:
        """Returns the part of the batch with the indices `kept` (n,)."""
        keys, values = ([tensor[kept] for tensor in tensors] for tensors in (self.keys, self.values))
        return EncodedInstruction(self.tokens[kept], self.known[kept], keys, values)


class Attention(nn.Module):
    """Multi-head attention. The keys and values can be computed once for many steps."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query, self.out = nn.Linear(width, width), nn.Linear(width, width)
        self.both = nn.Linear(width, 2 * width)

    def prepared(self, tokens: Tensor) -> tuple[Tensor, Tensor]:
        """Returns keys and values (B, heads, L, D / heads) of tokens (B, L, D)."""
        keys, values = self.both(tokens).chunk(2, dim=-1)
        return self._in_heads(keys), self._in_heads(values)

    def forward(self, asking: Tensor, keys: Tensor, values: Tensor, known: Tensor) -> Tensor:
        """Returns (B, Q, D) for queries `asking` (B, Q, D). Only tokens with `known` (B, L) true are attended to."""
        mask = known[:, None, None, :]
        found = functional.scaled_dot_product_attention(self._in_heads(self.query(asking)), keys, values, mask)
        return self.out(found.transpose(1, 2).flatten(2))

    def _in_heads(self, tokens: Tensor) -> Tensor:
        return tokens.unflatten(-1, (self.heads, -1)).transpose(1, 2)


class Layer(nn.Module):
    """A pre-norm transformer layer: cross-attention to the instruction (if `cross`), self-attention, and an MLP."""

    def __init__(self, config: ModelConfig, cross: bool) -> None:
        super().__init__()
        width = config.width
        self.to_text = Attention(width, config.heads) if cross else None
        self.text_norm = nn.LayerNorm(width) if cross else None
        self.norm, self.to_each_other = nn.LayerNorm(width), Attention(width, config.heads)
        self.last_norm = nn.LayerNorm(width)
        self.through = nn.Sequential(nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width))
        self.drop = nn.Dropout(0.0 if cross else config.dropout)

    def forward(self, tokens: Tensor, there: Tensor, text: tuple[Tensor, Tensor, Tensor] | None = None) -> Tensor:
        """Returns (B, L, D) for tokens (B, L, D), of which those with `there` (B, L) true exist.

        text   keys and values (B, heads, L', D / heads) and mask (B, L') of the instruction
        """
        if self.to_text is not None and self.text_norm is not None and text is not None:
            tokens = tokens + self.drop(self.to_text(self.text_norm(tokens), *text))
        normed = self.norm(tokens)
        tokens = tokens + self.drop(self.to_each_other(normed, *self.to_each_other.prepared(normed), there))
        return tokens + self.drop(self.through(self.last_norm(tokens)))


class RecurrentModel(nn.Module):
    """First `read` an instruction, then call `step` repeatedly: it returns scores of the slots and the next state."""

    def __init__(self, config: ModelConfig, words: int, features: int) -> None:
        super().__init__()
        self.config = config
        width, angle = config.width, config.angle_size
        self.words = nn.Embedding(words, width, padding_idx=0)
        self.places = nn.Parameter(0.02 * torch.randn(config.longest + 2, width))
        self.text_layers = nn.ModuleList(Layer(config, cross=False) for _ in range(config.text_layers))
        self.text_norm = nn.LayerNorm(width)
        self.view = nn.Linear(features, width)
        self.geometry = nn.Sequential(nn.Linear(angle + 1, width), nn.GELU(), nn.Linear(width, width))
        self.moved = nn.Sequential(nn.Linear(MOVED, width), nn.GELU(), nn.Linear(width, width))
        self.kinds = nn.Parameter(0.02 * torch.randn(4, width))  # the state, stopping, a candidate, any other view
        self.step_layers = nn.ModuleList(Layer(config, cross=True) for _ in range(config.step_layers))
        self.norm = nn.LayerNorm(width)
        self.choose, self.chosen = nn.Linear(width, width), nn.Linear(width, width)
        self.attend = nn.Linear(width, width)
        self.refine = nn.Linear(2 * width, width)
        self.state_norm = nn.LayerNorm(width)
        self.critic = nn.Sequential(nn.Linear(width, width), nn.GELU(), nn.Linear(width, 1))

    def read(self, words: Tensor) -> tuple[EncodedInstruction, Tensor]:
        """Encodes instructions (B, L) of word numbers, padded with 0, and returns them with the first states (B, D)."""
        if self.config.blind:
            words = torch.cat([words[:, :1], torch.full_like(words[:, :1], 2)], dim=1)  # only begin and end
        known = words != 0
        tokens = self.words(words) + self.places[: words.shape[1]]
        for layer in self.text_layers:
            tokens = layer(tokens, known)
        tokens = self.text_norm(tokens)
        prepared = [layer.to_text.prepared(tokens) for layer in self.step_layers]  # type: ignore[operator, union-attr]
        return EncodedInstruction(tokens, known, [k for k, _ in prepared], [v for _, v in prepared]), tokens[:, 0]

    def step(self, state: Tensor, text: EncodedInstruction, sight: AgentInput) -> tuple[Tensor, Tensor]:
        """Returns scores (B, K) of the slots, -inf for slots that do not exist, and the next states (B, D)."""
        distance = sight.distance if self.config.distances else torch.zeros_like(sight.distance)
        moved = sight.moved
        if not self.config.distances:
            moved = moved * torch.tensor([1.0, 1.0, 1.0, 0.0, 1.0, 0.0])
        slots = self._encode_views(sight.views, sight.angles, distance) + self.kinds[2]
        stop = (self.kinds[1] + torch.zeros_like(slots[:, :1])).to(slots.dtype)
        first = (state + self.moved(moved) + self.kinds[0])[:, None]
        tokens, there = [first, stop, slots[:, 1:]], [torch.ones_like(sight.open[:, :1]), sight.open]
        if sight.around is not None and sight.around_angles is not None:
            none = torch.zeros_like(sight.around_angles[..., 0])
            tokens.append(self._encode_views(sight.around, sight.around_angles, none) + self.kinds[3])
            there.append(torch.ones_like(none, dtype=torch.bool))
        x, present = torch.cat(tokens, dim=1), torch.cat(there, dim=1)
        for i, layer in enumerate(self.step_layers):
            x = layer(x, present, (text.keys[i], text.values[i], text.known))
        x = self.norm(x)
        count = sight.open.shape[1]
        state, slots = x[:, 0], x[:, 1 : 1 + count]
        scale = 1 / math.sqrt(self.config.width)
        scores = (self.chosen(slots) @ self.choose(state)[..., None])[..., 0] * scale
        scores = scores.masked_fill(~sight.open, -torch.inf)
        to_words = (text.tokens @ self.attend(state)[..., None])[..., 0] * scale
        heard = (to_words.masked_fill(~text.known, -torch.inf).softmax(1)[:, None] @ text.tokens)[:, 0]
        seen = (scores.softmax(1)[:, None] @ slots)[:, 0]
        return scores, self.state_norm(state + self.refine(torch.cat([state, heard * seen], dim=1)))

    def value(self, state: Tensor) -> Tensor:
        """Returns (B,) the reward that A2C's critic expects from states (B, D)."""
        return self.critic(state)[:, 0]

    def _encode_views(self, views: Tensor, angles: Tensor, distance: Tensor) -> Tensor:
        geometry = torch.cat([angles, distance[..., None] / FAR], dim=-1)
        shown = functional.dropout(torch.ones_like(geometry[..., :1]), self.config.feature_dropout, self.training)
        return self.view(views) * shown + self.geometry(geometry)
