"""Calibrates the thresholds against an occupancy map in a child process, because some seconds of Python in a thread
would make the window stutter. Does not use Qt."""

from __future__ import annotations

import json
import sys
import tempfile
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.state.child import Child, answer
from nvsim.errors import InputError
from nvsim.evaluation.calibrated import Calibration
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig

_NO_MAP = (
    "There is no occupancy map to compare with: select one with Map…, or build one from the capture with "
    "`nvsim occupancy build --project PROJECT`."
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


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The result of a calibration, and the occupancy map that was used."""

    found: Calibration
    map: Path


class CalibrationChild:
    """One calibration in a child process. `result` starts it."""

    def __init__(self, asked: Asked) -> None:
        self._asked = asked
        self._lock = threading.Lock()
        self._child: Child | None = None
        self._killed = False

    def result(self) -> Calibrated | None:
        """Runs the calibration and waits for it. None after `kill`. Raises InputError with the reason if it fails."""
        with tempfile.TemporaryDirectory(prefix="nvsim-calibration-") as folder:
            _write(Path(folder), self._asked)
            with self._lock:
                if self._killed:
                    return None
                self._child = Child("app.state.calibration_child", Path(folder), "The thresholds cannot be calibrated")
            found = self._child.output()
        if found is None:
            return None
        data = json.loads(found)
        return Calibrated(Calibration(**data["calibration"]), Path(data["map"]))

    def kill(self) -> None:
        """Ends the process. Can be called from any thread, also before the start and after the end."""
        with self._lock:
            self._killed = True
            if self._child is not None:
                self._child.kill()


def _write(folder: Path, asked: Asked) -> None:
    from nvsim.files.atomic import write_bytes, write_text
    from nvsim.graph.store import encode_graph

    write_bytes(folder / "graph", encode_graph(asked.graph))
    rest: dict[str, Any] = {"project": str(asked.project), "config": asdict(asked.config), "want": asked.want}
    rest |= {"truth": None if asked.truth is None else str(asked.truth), "in_capture": asked.in_capture}
    write_text(folder / "asked.json", json.dumps(rest))


def _work_out(folder: Path) -> dict[str, Any]:
    from nvsim.evaluation.calibration import calibrate
    from nvsim.evaluation.truth import true_occupancy
    from nvsim.graph.store import decode_graph
    from nvsim.project.occupancy_maps import true_map
    from nvsim.project.project import Project

    asked = json.loads((folder / "asked.json").read_text())
    graph, config = decode_graph((folder / "graph").read_bytes()), MappingConfig(**asked["config"])
    chosen = None if asked["truth"] is None else Path(asked["truth"])
    with Project.open(Path(asked["project"])) as project:
        truth = chosen or true_map(project)
        if truth is None:
            raise InputError(_NO_MAP)
        frame = "capture" if chosen is not None and asked["in_capture"] else "aligned"
        occupancy, positions = true_occupancy(project, truth, frame), project.need_capture().positions
    found = calibrate(graph, occupancy, positions, config, asked["want"], config.robot_radius)
    return {"calibration": asdict(found), "map": str(truth)}


if __name__ == "__main__":
    sys.exit(answer(lambda folder: json.dumps(_work_out(folder)).encode()))
