"""Edits a graph in the window with the keys and clicks of the tutorial "Fix a graph in the window".

Run as a program, because Qt selects its platform once per process: tutorial_window.py PROJECT. It prints what it saw
as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "gui"))
from editing_room import CTRL, SHIFT, Hand  # noqa: E402

from nvsim.project.stages.measured import unmeasured_viewpoints  # noqa: E402
from nvsim_app.session import Session  # noqa: E402
from nvsim_app.start.application import make_application  # noqa: E402
from nvsim_app.wiring.proposing import ProposePart  # noqa: E402

KEY = Qt.Key
ALT = Qt.KeyboardModifier.AltModifier
SECONDS = 300.0
NOTICES: list[str] = []
"""The notices of the window, the reasons if a step fails."""


def until(holds: Callable[[], object], name: str) -> None:
    """Runs the window until `holds` is true."""
    end = time.monotonic() + SECONDS
    while not holds():
        QApplication.processEvents()
        time.sleep(0.005)
        if time.monotonic() > end:
            raise SystemExit(f"the tutorial waits in vain for: {name}\n" + "\n".join(NOTICES))


def gaps(feet: NDArray[np.float64], edges: NDArray[np.int64]) -> list[tuple[int, NDArray[np.float64]]]:
    """Rows of a viewpoint, and places (3,) between it and another viewpoint without an edge to it; the nearest pairs
    first."""
    joined = {frozenset(pair) for pair in edges.tolist()}
    found = []
    for a, b in combinations(range(len(feet)), 2):
        middle, apart = (feet[a] + feet[b]) / 2, float(np.linalg.norm(feet[a] - feet[b]))
        if frozenset((a, b)) not in joined and np.linalg.norm(feet - middle, axis=1).min() > 0.4:
            found.append((apart, a, middle))
    return [(row, place) for _, row, place in sorted(found, key=lambda gap: gap[0])]


def follow(session: Session, seen: dict[str, object]) -> None:
    window, document = session.window, session.document
    editing, table = document.editing, window.actions_table
    _, plan = (canvas.surface for canvas in window.modes.canvases)
    hand = Hand(window, plan)
    until(lambda: document.graph is not None and editing.writable, "the graph")
    until(lambda: editing.checking.complete, "the findings")

    # Correct an edge.
    hand.key(KEY.Key_3, ALT)
    until(lambda: window.panels["validation"].isVisible(), "the workspace with the findings")
    window.panels["map"].frame_everything()
    hand.key(KEY.Key_F8)
    hand.key(KEY.Key_N)
    until(lambda: editing.selection.edges, "an edge to review")
    (first,) = editing.selection.edges
    hand.key(KEY.Key_Y)
    until(lambda: document.graph.edges[first].reviewed, "Y marks the edge as reviewed")
    hand.key(KEY.Key_N)
    (second,) = editing.selection.edges
    assert second != first
    hand.key(KEY.Key_Delete)
    until(lambda: second not in document.graph.edges, "Del removes the edge")
    hand.key(KEY.Key_Z, CTRL)
    until(lambda: second in document.graph.edges, "Ctrl+Z restores the edge")

    # Add a viewpoint, in the first gap where more edges are proposed.
    part = window.part(ProposePart)
    arrays, before = document.graph_arrays, document.graph
    for row, place in gaps(arrays.feet, arrays.edges):
        hand.key(KEY.Key_Escape)
        hand.click(hand.foot(row))
        until(lambda row=row: editing.selection.viewpoints == {arrays.ids[row]}, "a click selects the viewpoint")
        hand.key(KEY.Key_P)
        hand.click(place, SHIFT)
        until(lambda: len(document.graph.viewpoints) == len(before.viewpoints) + 1, "a click adds a viewpoint")
        (added,) = set(document.graph.viewpoints) - set(before.viewpoints)
        assert any({added, arrays.ids[row]} == set(key) for key in document.graph.edges)
        until(
            lambda: not unmeasured_viewpoints(document.graph) and not part.process.running,
            "the evidence of the viewpoint",
        )
        if table["accept_proposals"].isEnabled():
            break
        hand.key(KEY.Key_Z, CTRL)
        until(lambda: len(document.graph.viewpoints) == len(before.viewpoints), "Ctrl+Z removes the viewpoint")
    count = len(document.graph.edges)
    hand.key(KEY.Key_Return, CTRL)
    until(lambda: len(document.graph.edges) > count, "Ctrl+Return accepts the proposed edges")

    hand.key(KEY.Key_S, CTRL)
    until(lambda: not editing.dirty, "Ctrl+S saves the graph")
    seen.update(added=added, reviewed=list(first), viewpoints=len(document.graph.viewpoints))
    seen["edges"] = sorted(map(list, document.graph.edges))


if __name__ == "__main__":
    project = Path(sys.argv[1])
    settings = QSettings(str(project.resolve().parent / "window.ini"), QSettings.Format.IniFormat)
    application = make_application("dark", settings)
    session = Session(settings)
    session.window.resize(1280, 800)
    session.window.show()
    session.notices.added.connect(lambda notice: NOTICES.append(notice.text))
    session.open(project)
    seen: dict[str, object] = {}
    try:
        follow(session, seen)
    finally:
        session.close()
    QTest.qWait(200)
    print(json.dumps(seen))
