"""What the window shows belongs to the graph on screen and to the open file."""

from __future__ import annotations

from pathlib import Path

import demo_room
import pytest
from editing_room import Hand
from PySide6.QtWidgets import QApplication

from app.painting import cameras
from app.state.document import Document
from app.state.loading import Contents
from app.wiring.proposing import ProposePart
from app.wiring.window import MainWindow


@pytest.fixture
def hand(window: MainWindow) -> Hand:
    window.scene.navigation.set_pose(cameras.top_view(window.document.extent, 1.4))
    QApplication.processEvents()
    return Hand(window, window.modes.canvases[0].surface)


def test_a_doubtful_edge_is_forgotten_when_the_move_is_undone(window: MainWindow, document: Document) -> None:
    part = next(p for p in window.parts if isinstance(p, ProposePart))
    key = next(iter(document.graph.edges))
    document.editing.run("shift_viewpoints", {"ids": [key[0]], "by": [0.1, 0.0, 0.0]})
    part.proposals.add(document.graph, (), (key,))
    document.editing.run("mark_reviewed", {"viewpoints": [key[1]], "edges": []})
    assert part.proposals.doubted == (key,)
    document.editing.undo()
    assert part.proposals.doubted == (key,)
    document.editing.undo()
    assert not part.proposals.doubted


def test_a_label_at_the_mouse_pointer_ends_with_its_file(hand: Hand) -> None:
    modes = hand.window.modes
    modes.choose("add_edge")
    hand.hover(hand.foot(5))
    assert modes.current._now is not None
    hand.document.set_contents(Contents(Path("other.nvsim")))
    assert modes.current._now is None and all(canvas.cursor_at is None for canvas in modes.canvases)
    hand.document.set_contents(demo_room.contents(Path("demo.nvsim")))
