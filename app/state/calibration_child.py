"""Calibrates the thresholds against an occupancy map in a side process, because some seconds of Python in a thread
would make the window stutter. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.processes.child import Program
from app.processes.serving import Requests
from nvsim.errors import InputError
from nvsim.evaluation.calibrated import Calibration
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig

_NO_MAP = (
    "There is no occupancy map to compare with: select one with Map…, or compute one from the capture in a terminal."
)


@dataclass(frozen=True, eq=False)
class Asked:
    """The input of a calibration.

    graph        the displayed graph
    config       the thresholds to evaluate
    truth        the file of an occupancy map, None for the map of the project
    in_capture   whether `truth` is in the coordinate frame of the capture instead of the project
    want         the required lower bound of the validity
    """

    project: Path
    graph: NavGraph
    config: MappingConfig
    truth: Path | None = None
    in_capture: bool = False
    want: float = 0.99

    def __reduce__(self) -> tuple[object, ...]:
        """Encodes the graph, because pickling it would block the window for longer."""
        from nvsim.graph.store import encode_graph

        return _decoded, (encode_graph(self.graph), self.project, self.config, self.truth, self.in_capture, self.want)


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The result of a calibration, and the occupancy map that was used."""

    found: Calibration
    map: Path


def _decoded(graph: bytes, project: Path, *rest: Any) -> Asked:
    from nvsim.graph.store import decode_graph

    return Asked(project, decode_graph(graph), *rest)


def _calibrate(requests: Requests, asked: Asked) -> Calibrated:
    from nvsim.evaluation.calibration import calibrate
    from nvsim.evaluation.truth import true_occupancy
    from nvsim.project.occupancy_maps import true_map
    from nvsim.project.project import Project

    with Project.open(asked.project) as project:
        truth = asked.truth or true_map(project)
        if truth is None:
            raise InputError(_NO_MAP)
        frame = "capture" if asked.truth is not None and asked.in_capture else "aligned"
        occupancy, positions = true_occupancy(project, truth, frame), project.need_capture().positions
    config = asked.config
    return Calibrated(calibrate(asked.graph, occupancy, positions, config, asked.want, config.robot_radius), truth)


CALIBRATION = Program(_calibrate, "calibration", "The thresholds cannot be calibrated")
"""Asked -> Calibrated"""
