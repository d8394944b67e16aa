"""What a single edit of a large graph takes in the window until map and 3D view have painted it, everything in view:
operation, history, difference, findings and both paintings.

QT_QPA_PLATFORM=offscreen python -m tests.benchmarks.edit_paint
"""

from __future__ import annotations

import json
import random
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication

from app.application import make_application
from app.document import Document
from app.loading import Contents
from app.map_view import MapView
from app.notices import Notices
from app.window import MainWindow
from nvsim.graph.benchmark import random_graph, random_map
from tests.benchmarks.threshold_slider import turns

EDITS = 120


def measured(viewpoints: int, settings: QSettings) -> dict[str, float]:
    """Milliseconds: edit_p95_ms without, paint_p95_ms with the painting of both views, and the median of that."""
    document = Document()
    window = MainWindow(document, settings, Notices())
    window.resize(1600, 1000)
    window.show()
    graph = random_graph(viewpoints, directions=0, seed=0)
    document.set_contents(Contents(Path("field.nvsim"), graph=graph, occupancy=random_map(graph)))
    plan = window.panels["map"]
    assert isinstance(plan, MapView)
    turns(lambda: bool(document.editing.findings), 1.5)
    window.scene.look_over()
    plan.frame_everything()
    turns(lambda: True, 1.0)
    rng, editing, edits, whole = random.Random(0), document.editing, [], []
    for _ in range(EDITS):
        name, arguments = _edit(document, rng)
        begin = time.perf_counter()
        done = editing.run(name, arguments)
        edited = time.perf_counter()
        window.scene.repaint()
        plan.canvas.repaint()
        if done:
            edits.append(1e3 * (edited - begin))
            whole.append(1e3 * (time.perf_counter() - begin))
        QApplication.processEvents()
    editing.close()
    window.close()
    return {
        "viewpoints": len(graph.viewpoints),
        "edges": len(graph.edges),
        "edit_p95_ms": round(float(np.percentile(edits, 95)), 1),
        "paint_p95_ms": round(float(np.percentile(whole, 95)), 1),
        "paint_median_ms": round(float(np.median(whole)), 1),
    }


def _edit(document: Document, rng: random.Random) -> tuple[str, dict[str, Any]]:
    graph = document.graph
    assert graph is not None
    id = rng.choice(list(graph.viewpoints))
    near = rng.choice(graph.neighbours(id) or (id,))
    x, y, z = graph.viewpoints[id].position
    return rng.choice(
        [
            ("shift_viewpoints", {"ids": [id], "by": [0.2, 0.1, 0.0]}),
            ("remove_viewpoints", {"ids": [id]}),
            ("remove_edges", {"pairs": [[id, near]]}),
            ("include", {"ids": [id], "included": False}),
            ("add_viewpoint", {"position": [x + 0.7, y + 0.7, z]}),
            ("split_edge", {"edge": [id, near]}),
        ]
    )


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        settings = QSettings(f"{folder}/window.ini", QSettings.Format.IniFormat)
        make_application("dark", settings)
        print(json.dumps(measured(10_000, settings)))


if __name__ == "__main__":
    main()
