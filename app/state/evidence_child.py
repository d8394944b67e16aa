"""Measures added or moved viewpoints in a child process while the user continues to edit."""

from __future__ import annotations

import json
import math
import os
import sys
import tempfile
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, QProcessEnvironment, Signal

from nvsim.errors import InputError
from nvsim.files.atomic import write_bytes
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.graph.types import NavGraph
from nvsim.mapping.new_viewpoint_evidence import NewViewpointEvidence

AROUND = 8.0  # meters; viewpoints farther from the measured ones do not affect the result


class EvidenceChild(QObject):
    """Runs `nvsim graph evidence` for some viewpoints.

    measured(NewViewpointEvidence, dict)   the evidence, and the measured positions by viewpoint id
    failed(str)                            a sentence for the user
    """

    measured = Signal(object, object)
    failed = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._process: QProcess | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._asked: dict[str, tuple[float, float, float]] = {}

    @property
    def busy(self) -> bool:
        return self._process is not None

    def start(self, project: Path, graph: NavGraph, ids: list[str]) -> None:
        """Measures the viewpoints `ids` of `graph`. Does nothing while a measurement runs."""
        if self.busy or not ids:
            return
        self._asked = {id: graph.viewpoints[id].position for id in ids}
        self._folder = tempfile.TemporaryDirectory(prefix="nvsim-evidence-")
        source, result = Path(self._folder.name) / "asked", Path(self._folder.name) / "found"
        write_bytes(source, encode_graph(_part(graph, ids)))
        process = QProcess(self)
        environment = QProcessEnvironment.systemEnvironment()
        environment.insert("PYTHONPATH", os.pathsep.join(p for p in sys.path if p))
        process.setProcessEnvironment(environment)
        process.finished.connect(self._on_finished)
        words = ["-P", "-m", "nvsim.cli.main", "graph", "evidence", f"--project={project}", "--json"]
        words += [f"--graph={source}", f"--out={result}", "--viewpoints", *ids]
        self._process = process
        process.start(sys.executable, words)

    def stop(self) -> None:
        """Ends a running measurement without emitting a signal."""
        process, self._process = self._process, None
        if process is not None:
            process.finished.disconnect(self._on_finished)
            process.kill()
            process.waitForFinished(3000)
            process.deleteLater()
        self._clear()

    def _clear(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def _on_finished(self, code: int) -> None:
        process, self._process = self._process, None
        if process is None or self._folder is None:
            return
        lines = bytes(process.readAllStandardOutput().data()).decode(errors="replace").splitlines()
        words = bytes(process.readAllStandardError().data()).decode(errors="replace").strip().splitlines()
        process.deleteLater()
        result = Path(self._folder.name) / "found"
        try:
            if code != 0 or not result.is_file():
                raise InputError(words[-1] if words else f"Measuring viewpoints ended with code {code}.")
            found = decode_graph(result.read_bytes())
            outcome = next((r for r in map(_results, reversed(lines)) if r is not None), {})
        except (InputError, OSError) as error:
            self._clear()
            self.failed.emit(str(error))
            return
        self._clear()
        ids = set(self._asked)
        self.measured.emit(
            NewViewpointEvidence(
                tuple(e for e in found.evidence.values() if e.viewpoint in ids or e.joins in ids),
                {id: found.viewpoints[id].submap for id in ids if id in found.viewpoints},
                tuple((a, b) for a, b in outcome.get("proposed", ())),
                tuple((a, b) for a, b in outcome.get("doubted", ())),
                {id: found.viewpoints[id].photographed for id in ids if id in found.viewpoints},
            ),
            self._asked,
        )


def _part(graph: NavGraph, ids: list[str]) -> NavGraph:
    """The part of the graph that affects the measurement: near viewpoints with their edges and corridors."""
    centres = [graph.viewpoints[id].position for id in ids]
    near = {
        id: v for id, v in graph.viewpoints.items() if any(math.dist(v.position, centre) < AROUND for centre in centres)
    }
    for id in ids:
        near |= {other: graph.viewpoints[other] for other in graph.neighbours(id)}
    return NavGraph(
        graph.scan,
        near,
        {key: e for key, e in graph.edges.items() if key[0] in near and key[1] in near},
        {key: e for key, e in graph.evidence.items() if e.joins and e.viewpoint in near and e.joins in near},
    )


def _results(line: str) -> dict[str, list[tuple[str, str]]] | None:
    """The results of a Done event, None if the line is not one."""
    try:
        event = json.loads(line)
    except ValueError:
        return None
    results = event.get("results") if isinstance(event, dict) else None
    return results if isinstance(results, dict) and "proposed" in results else None
