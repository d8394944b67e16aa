"""The inputs of a fuzzing run."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fuzzing.damage import STRANGERS, Damage
from fuzzing.forms import damaged
from fuzzing.reader import Files, Reader, Seed


@dataclass(frozen=True)
class Plan:
    """The inputs of a run. An input depends only on the seed, its reader, and its index."""

    readers: Sequence[Reader]
    seeds: dict[str, list[Seed]]
    seed: int

    @cached_property
    def _drawn(self) -> list[Reader]:
        return [r for r in self.readers for _ in range(r.share)]

    def reader(self, index: int) -> Reader:
        return self._drawn[index % len(self._drawn)]

    def input(self, index: int) -> tuple[Reader, Seed, Files, str]:
        """The reader, the seed, all files after the damage, and a description of the damage."""
        reader = self.reader(index)
        dice = random.Random(f"{self.seed} {reader.name} {index}")
        seed = dice.choice(self.seeds[reader.name])
        own = [each.files[each.target] for each in self.seeds[reader.name]]
        other = dice.choice([*STRANGERS, *own])
        d = Damage(dice)
        files = {**seed.files, seed.target: damaged(d, seed.files[seed.target], seed.form, other)}
        if seed.seal is not None:
            files = seed.seal(files)
        return reader, seed, files, f"{seed.target}: {'; '.join(d.said) or 'nothing'}"
