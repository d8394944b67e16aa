"""The rows of the two tables that compare trainings: the paper's ablation, and the comparison of presets."""

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
    """A row of a table.

    name     identifies the row in files and options
    title    text for readers
    config   training configuration of the row
    """

    name: str
    title: str
    config: TrainingConfig


@dataclass(frozen=True)
class Budget:
    """The training budget, equal for all rows. None uses the value of the preset `nvsim`."""

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
    """The paper's second table, cumulative from Splatfacto-W to Splatfacto-i. If `names` is not empty, only these rows.

    The configurations are built from the last row upwards: each row is the next row without that row's change. Points
    on the floor are used as seeds in all rows above the suppression. Raises InputError if a name is not a row.
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
    """One row per preset, from plain 3DGS to `nvsim`. If `names` is not empty, only these rows. Raises InputError if a
    name is not a preset."""
    order = sorted(PRESETS, key=lambda n: _ORDER.index(n) if n in _ORDER else len(_ORDER))
    return _chosen(tuple(Row(n, n, budget.applied(preset(n))) for n in order), names, "presets")


def _chosen(rows: tuple[Row, ...], names: Sequence[str], what: str) -> tuple[Row, ...]:
    known = {row.name for row in rows}
    unknown = [n for n in names if n not in known]
    if unknown:
        raise InputError(f"--{what} {unknown[0]} is not known; choose from {', '.join(r.name for r in rows)}.")
    return tuple(row for row in rows if not names or row.name in names)
