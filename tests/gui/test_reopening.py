"""A reopened project restores the selection, unless the user has changed it since."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import demo_room
import pytest
from PySide6.QtWidgets import QApplication

from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.frames import FramePart
from nvsim_app.wiring.window import MainWindow

FRAME = 50
PROJECT = Path("demo.nvsim")


def arrive(document: Document) -> Contents:
    """As the thread reads a project: nothing yet, then the capture, then the rest."""
    contents = demo_room.contents(PROJECT)
    document.set_contents(Contents(PROJECT))
    document.set_contents(replace(Contents(PROJECT), capture=contents.capture))
    document.set_contents(contents)
    QApplication.processEvents()
    return contents


def frames(window: MainWindow) -> FramePart:
    return window.part(FramePart)


@pytest.mark.parametrize("in_the_center", [False, True])
@pytest.mark.parametrize("again_in", ["another window", "the same window"])
def test_a_selected_frame_is_selected_again_until_the_user_clears_it(
    make_window: Callable[[Document], MainWindow], document: Document, in_the_center: bool, again_in: str
) -> None:
    window = make_window(document)
    if in_the_center:
        frames(window).browser.open(FRAME)
    else:
        document.select(frame=FRAME)
    QApplication.processEvents()
    window.scene.poseChanged.emit(window.scene.pose)
    if again_in == "another window":
        window.close()
        document = Document()
        window = make_window(document)
    else:
        document.set_contents(Contents())
        QApplication.processEvents()
        assert document.page_frame is None and not document.selection

    contents = arrive(document)
    assert document.selection.frame == FRAME
    assert (frames(window).shown.frame == FRAME) == in_the_center

    document.select()
    document.set_contents(replace(contents, training={0: 5}))  # as jobs go on
    document.set_contents(contents)
    assert not document.selection
    window.close()
    third = Document()
    make_window(third)
    arrive(third)
    assert not third.selection


def test_a_frame_that_the_capture_lost_is_not_selected_while_panels_refresh(
    make_window: Callable[[Document], MainWindow], document: Document
) -> None:
    window = make_window(document)
    frames(window).browser.open(110)
    QApplication.processEvents()
    few = demo_room.capture(100)
    document.set_contents(replace(document.contents, capture=few, submaps=demo_room.submaps(few)))
    QApplication.processEvents()
    assert not document.selection
    assert document.page_frame is None or document.page_frame < 100
