"""Kernels for the first drawing are compiled ahead, and the window gives the reason for a long wait."""

from __future__ import annotations

from pathlib import Path

import pytest
from demo_project import write_project
from demo_room import RoomSource
from pytestqt.qtbot import QtBot

from nvsim_app.drawing import warming
from nvsim_app.drawing.painter import Painter
from nvsim_app.drawing.picture_feed import COMPILING, LOADING, PictureFeed, RenderLink
from nvsim_app.drawing.render_child import ProjectSource
from nvsim_app.drawing.warming import Warming
from nvsim_app.inspector.panoramas import Panoramas
from nvsim_app.painting.cameras import ViewPose


@pytest.fixture(scope="module")
def painter(tmp_path_factory: pytest.TempPathFactory) -> Painter:
    return Painter(ProjectSource(write_project(tmp_path_factory.mktemp("warm") / "room.nvsim", 400, 1)).open())


def test_on_a_machine_that_compiles_everything_follows_at_once(painter: Painter, monkeypatch) -> None:
    monkeypatch.setattr(warming, "COLD", 0.0)
    made = Warming(painter)
    made.begin()
    assert not made.has_waiting_kernels


def test_on_one_that_has_compiled_the_rest_is_left_to_the_pauses(painter: Painter, monkeypatch) -> None:
    monkeypatch.setattr(warming, "COLD", 1e9)
    made = Warming(painter)
    made.begin()
    steps = 0
    while made.has_waiting_kernels:
        made.step()
        steps += 1
    assert steps > 4  # so that a picture that is asked for meanwhile waits for one small view only


def test_a_source_that_draws_by_itself_has_nothing_to_compile() -> None:
    made = Warming(Painter(RoomSource().open()))
    made.begin()
    assert not made.has_waiting_kernels


def test_whoever_waits_for_a_compilation_hears_why(qtbot: QtBot, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("nvsim_app.drawing.picture_feed.PATIENCE", 10)
    compiled = [False]
    monkeypatch.setattr("nvsim_app.drawing.picture_feed.compiled_since", lambda begun: compiled[0])
    feed = PictureFeed(lambda: (64, 48), lambda: ViewPose((0.0, 0.0, 1.0)))
    feed.show(RoomSource(burn=0.3))
    assert feed.note == LOADING
    qtbot.wait(60)
    assert feed.note == LOADING  # it loads, but nothing was compiled
    compiled[0] = True
    qtbot.waitUntil(lambda: feed.note == COMPILING, timeout=20_000)
    qtbot.waitUntil(lambda: feed.note == "", timeout=20_000)
    feed.release()


def test_a_first_panorama_that_takes_long_says_why(qtbot: QtBot, monkeypatch) -> None:
    monkeypatch.setattr("nvsim_app.inspector.panoramas.PATIENCE", 10)
    monkeypatch.setattr("nvsim_app.inspector.panoramas.compiled_since", lambda asked: True)
    panoramas = Panoramas(RenderLink())
    with qtbot.waitSignal(panoramas.arrived, timeout=20_000):
        panoramas.request((1.0, 2.0, 3.0))
        assert "compiled" not in panoramas.words
    assert "compiled" in panoramas.words
    panoramas.close()
