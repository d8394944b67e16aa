"""Compare sets of map criteria (alpha, Gaussian normals, network normals) on a map with known ground truth.

python -m tests.benchmarks.witnesses PROJECT --occupancy MAP [--support 0]

The map must have been built with --criteria alpha normal network-normal, or with fewer criteria that use the network,
so that all evidence is stored. Its edges are decided again, and the map does not change. A row is a set of criteria
with the current thresholds. The row below it is that set at equal recall: its thresholds are scaled so that it accepts
as many free corridors as alpha with Gaussian normals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray

from nvsim.evaluation.calibration import Corridors
from nvsim.evaluation.interval import wilson
from nvsim.evaluation.truth import true_occupancy
from nvsim.mapping.config import MappingConfig
from nvsim.project.project import Project

SETS = (
    ("alpha", "normal"), ("alpha",), ("normal",), ("network-normal",), ("alpha", "network-normal"),
    ("alpha", "normal", "network-normal"),
)  # fmt: skip
_STEPS = 60  # steps of a sweep in each direction


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    occupancy: Path
    support: float = 0.0
    """Share of every row that must be known floor. Known floor hides differences between the criteria."""


def main() -> None:
    a = tyro.cli(Arguments, description=__doc__)
    with Project.open(a.project) as project:
        corridors = Corridors(project.need_graph(), true_occupancy(project, a.occupancy, "aligned"), 0.25)
    print(f"{len(corridors.free)} corridors, {corridors.free.sum()} free, {corridors.free_robot.sum()} for a robot")
    base = MappingConfig(support=a.support)
    asked = _recall(corridors, replace(base, criteria=SETS[0]))
    for names in SETS:
        config = replace(base, criteria=names)
        _say(", ".join(names), corridors, config)
        swept = [(abs(_recall(corridors, c) - asked), c) for c in _stricter(config)]
        _say("  at equal recall", corridors, min(swept, key=lambda s: s[0])[1])


def _stricter(config: MappingConfig) -> list[MappingConfig]:
    """The thresholds of a set from loose to strict. All move by an equal share of the distance to 0 or 1."""
    ends = dict.fromkeys(("tau_alpha", "row_alpha", "cell_alpha"), 0.0)
    ends |= dict.fromkeys(("tau_normal", "row_normal", "tau_network_normal", "row_network_normal"), 1.0)
    found = []
    for share in np.linspace(-1, 1, 2 * _STEPS + 1):
        now = {name: getattr(config, name) for name in ends}
        values = {n: v + abs(share) * ((ends[n] if share > 0 else 1 - ends[n]) - v) for n, v in now.items()}
        found.append(replace(config, **values))
    return found


def _recall(corridors: Corridors, config: MappingConfig) -> float:
    return float((corridors.accepted(config) & corridors.free).sum() / max(1, corridors.free.sum()))


def _say(name: str, corridors: Corridors, config: MappingConfig) -> None:
    accepted = corridors.accepted(config)
    words = [f"{name:32} {int(accepted.sum()):5} accepted, {_recall(corridors, config):.3f} of the free;"]
    for who, free in (("point", corridors.free), ("robot", corridors.free_robot)):
        words.append(f"{who} {_valid(accepted, free)}")
    print(" ".join(words))


def _valid(accepted: NDArray[np.bool_], free: NDArray[np.bool_]) -> str:
    count, valid = int(accepted.sum()), int((accepted & free).sum())
    low, high = wilson(valid, count)
    return f"{valid / max(1, count):.3f} ({low:.3f} to {high:.3f})"


if __name__ == "__main__":
    main()
