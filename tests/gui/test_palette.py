"""The command palette: finds what was meant, says why something cannot run, gives the focus back."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from nvsim_app.palette.entries import PaletteEntry, match_score
from nvsim_app.state.document import Document
from nvsim_app.wiring import actions
from nvsim_app.wiring.appearance import PalettePart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture
def part(window: MainWindow) -> PalettePart:
    return window.part(PalettePart)


def rows(part: PalettePart) -> list[PaletteEntry]:
    return [part.view.list.item(i).data(Qt.ItemDataRole.UserRole) for i in range(part.view.list.count())]


def best(typed: str, *texts: str) -> str:
    scored = {text: found for text in texts if (found := match_score(typed, text)) is not None}
    return max(scored, key=lambda text: scored[text][0])


def test_starts_of_words_and_runs_fit_better_than_scattered_letters() -> None:
    assert best("fs", "Full screen", "Offsets", "Show files") == "Full screen"
    assert best("focus", "Focus on selection", "Frame of cameras used") == "Focus on selection"
    assert best("norm", "Normals", "Panorama of rooms") == "Normals"
    assert match_score("zz", "Normals") is None
    assert match_score("screen full", "Full screen") is not None, "in any order"
    assert match_score("fsel", "Focus on selection") == (match_score("FSEL", "Focus on selection"))


def test_marked_letters_are_those_that_were_typed() -> None:
    found = match_score("ovw", "Overview")
    assert found is not None and "".join("Overview"[i] for i in found[1]).lower() == "ovw"


def test_every_command_is_offered_and_those_that_cannot_run_say_why(part: PalettePart) -> None:
    part.view.open()
    offered = rows(part)
    panels = [e for e in offered if e.title.startswith("Show panel ")]
    layers = [e for e in offered if e.title.startswith("Layer ")]
    assert len(offered) - len(panels) - len(layers) == len(actions()) - 1
    assert len(layers) == len(part.context.scene.overlays.layers)
    assert len(panels) == len(part.context.window.panels)
    kinds = [bool(e.reason) for e in offered]
    assert kinds == sorted(kinds), "what cannot run comes last"
    part.view.line.setText("zoom to sel")
    first = rows(part)[0]
    assert first.title == "Zoom to selection" and first.reason == "nothing in the graph is selected"
    assert first.shortcut == "Z"


def test_a_layer_is_shown_and_hidden_from_the_palette(part: PalettePart, window: MainWindow, qtbot: QtBot) -> None:
    for shown in (True, False):
        qtbot.keyClick(
            window.scene, Qt.Key.Key_P, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
        )
        qtbot.keyClicks(part.view.line, "layer point cl")
        qtbot.keyClick(part.view.line, Qt.Key.Key_Return)
        assert window.scene.overlays["cloud"].shown is shown


def test_return_runs_what_is_chosen_and_closes(part: PalettePart, window: MainWindow, qtbot: QtBot) -> None:
    part.view.open()
    assert part.view.isVisible()
    qtbot.keyClicks(part.view.line, "alpha")
    qtbot.keyClick(part.view.line, Qt.Key.Key_Return)
    assert not part.view.isVisible() and window.scene.feed.channel == "alpha"
    part.view.open()
    assert rows(part)[0].title == "Alpha", "what was used lately comes first"
    qtbot.keyClick(part.view.line, Qt.Key.Key_Escape)
    assert not part.view.isVisible()


def test_a_command_that_cannot_run_stays_open_under_its_reason(part: PalettePart, qtbot: QtBot) -> None:
    part.view.open()
    qtbot.keyClicks(part.view.line, "turn upright")
    qtbot.keyClick(part.view.line, Qt.Key.Key_Return)
    assert part.view.isVisible() and rows(part)[0].reason


def test_viewpoints_and_frames_are_found_by_name(
    part: PalettePart, document: Document, qtbot: QtBot, window: MainWindow
) -> None:
    id = document.graph_arrays.ids[5]
    part.view.open()
    part.view.line.setText(id[:8])
    assert rows(part)[0].title == id
    qtbot.keyClick(part.view.line, Qt.Key.Key_Return)
    assert document.selection.viewpoint == id
    part.view.open()
    part.view.line.setText("frame_00017")
    qtbot.keyClick(part.view.line, Qt.Key.Key_Return)
    assert document.selection.frame == 17


def test_up_and_down_go_round(part: PalettePart, qtbot: QtBot) -> None:
    part.view.open()
    qtbot.keyClick(part.view.line, Qt.Key.Key_Up)
    assert part.view.list.currentRow() == part.view.list.count() - 1
    qtbot.keyClick(part.view.line, Qt.Key.Key_Down)
    assert part.view.list.currentRow() == 0


def test_what_was_used_comes_back_with_the_next_window(part: PalettePart, window: MainWindow) -> None:
    part._recent = ["Home"]
    part.store(window.settings)
    part._recent = []
    part.restore(window.settings)
    assert part._recent == ["Home"]
