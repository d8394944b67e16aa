"""The rows of the two tables that training is judged by: the paper's ablation, and the comparison of the presets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from nvsim.errors import InputError
from nvsim.training.config import PRESETS, TrainingConfig, preset

ABLATION, COMPARISON = "ablation", "presets"
TABLES = (ABLATION, COMPARISON)
_ORDER = ("3dgs", "splatfacto-w", "splatfacto-i", "nvsim")
ROWS = ("base", "masking", "suppression", "floor", "ours")


@dataclass(frozen=True)
class Row:
    """A line of a table: `name` in files and flags, `title` for a reader, and what is trained for it."""

    name: str
    title: str
    config: TrainingConfig


@dataclass(frozen=True)
class Budget:
    """What every row is given alike. None: as the preset `nvsim` has it."""

    steps: int | None = None
    image_size: int | None = None
    gaussian_cap: int | None = None

    def applied(self, config: TrainingConfig) -> TrainingConfig:
        ours = preset("nvsim")
        return replace(
            config,
            steps=self.steps or ours.steps,
            image_size=self.image_size or ours.image_size,
            gaussian_cap=self.gaussian_cap or ours.gaussian_cap,
        )


def ablation_rows(budget: Budget, names: Sequence[str] = ()) -> tuple[Row, ...]:
    """The paper's second table, cumulative from Splatfacto-W to Splatfacto-i; only `names` where any is given.

    It is undone from the last row: each row is the one after it without that row's part. Points on the floor are seeds
    until the suppression is on. Raises InputError for a name that is no row.
    """
    base, ours = preset("splatfacto-w"), preset("splatfacto-i")
    floor = replace(ours, loss=replace(ours.loss, alpha=base.loss.alpha))
    suppression = replace(floor, loss=replace(floor.loss, floor=0.0))
    masking = replace(
        suppression,
        seed_height=base.seed_height,
        loss=replace(suppression.loss, suppression=0.0, mask_floor=True),
    )
    configs = (base, masking, suppression, floor, ours)
    titles = (
        "Splatfacto-w (base)",
        "+ masking, pose embedding",
        "+ floor suppression",
        "+ background floor loss",
        "- alpha loss (Splatfacto-i)",
    )
    rows = tuple(Row(n, t, budget.applied(c)) for n, t, c in zip(ROWS, titles, configs, strict=True))
    return _chosen(rows, names, "rows")


def preset_rows(budget: Budget, names: Sequence[str] = ()) -> tuple[Row, ...]:
    """A row per preset, from Gaussians only to ours; only `names` where any is given. Raises InputError."""
    order = sorted(PRESETS, key=lambda n: _ORDER.index(n) if n in _ORDER else len(_ORDER))
    return _chosen(tuple(Row(n, n, budget.applied(preset(n))) for n in order), names, "presets")


def _chosen(rows: tuple[Row, ...], names: Sequence[str], what: str) -> tuple[Row, ...]:
    known = {row.name for row in rows}
    unknown = [n for n in names if n not in known]
    if unknown:
        raise InputError(f"--{what} {unknown[0]} is not known; choose from {', '.join(r.name for r in rows)}.")
    return tuple(row for row in rows if not names or row.name in names)
