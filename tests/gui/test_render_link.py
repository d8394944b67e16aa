"""The drawing process: answers, replaces stale wishes, survives failures, leaves nothing behind."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import tau

import demo_room
import psutil
import pytest
from pytestqt.qtbot import QtBot

from nvsim.errors import InputError
from nvsim_app.benchmarks.window import GapRecorder
from nvsim_app.drawing.painter import Renderer
from nvsim_app.drawing.picture_feed import RenderLink
from nvsim_app.drawing.render_child import Picture, Request
from nvsim_app.painting.cameras import ViewPose

POSE = ViewPose((7.0, 4.5, 1.5), 0.4)


def wish(number: int, width: int = 64, height: int = 48, channel: str = "rgb") -> Request:
    return Request(number, POSE.camera(width, height), channel, False)


@pytest.fixture
def link(qtbot: QtBot) -> Iterator[RenderLink]:
    made = RenderLink()
    yield made
    made.close()


@dataclass(frozen=True)
class NothingThere:
    def open(self) -> Renderer:
        raise InputError("There is no model.")


def test_a_wish_is_answered_with_its_picture(link: RenderLink, qtbot: QtBot) -> None:
    with qtbot.waitSignal(link.arrived, timeout=20_000) as heard:
        link.ask(wish(1))  # before the process is ready: it waits
        link.open(demo_room.RoomSource())
    picture: Picture = heard.args[0]
    assert picture.request.number == 1 and picture.pixels.shape == (48, 64, 4) and picture.pixels[..., :3].std() > 5


def test_only_the_newest_wish_waits(link: RenderLink, qtbot: QtBot) -> None:
    numbers: list[int] = []
    link.arrived.connect(lambda p: numbers.append(p.request.number))
    link.open(demo_room.RoomSource(burn=0.05))
    qtbot.waitUntil(lambda: link.ready, timeout=20_000)
    for number in range(1, 21):
        link.ask(wish(number))
    qtbot.waitUntil(lambda: 20 in numbers, timeout=10_000)
    assert numbers == [1, 20]


def test_a_source_that_cannot_be_opened_is_reported_once(link: RenderLink, qtbot: QtBot) -> None:
    with qtbot.waitSignal(link.troubled, timeout=20_000) as heard:
        link.open(NothingThere())
    assert heard.args[0].fatal and heard.args[0].message == "There is no model."


def test_a_view_that_fails_does_not_end_the_process(link: RenderLink, qtbot: QtBot) -> None:
    link.open(demo_room.RoomSource(fail=1))  # view 0 is the warm-up
    with qtbot.waitSignal(link.troubled, timeout=20_000) as heard:
        link.ask(wish(1))
    assert not heard.args[0].fatal and "the test wanted this" in heard.args[0].message
    with qtbot.waitSignal(link.arrived, timeout=10_000):
        link.ask(wish(2))


def test_a_process_that_is_killed_is_started_again_and_finishes_the_work(link: RenderLink, qtbot: QtBot) -> None:
    link.open(demo_room.RoomSource())
    qtbot.waitUntil(lambda: link.ready, timeout=20_000)
    child = next(p for p in psutil.Process().children() if p.pid == link.process_id)
    with qtbot.waitSignal(link.troubled, timeout=10_000) as heard:
        child.kill()
    assert not heard.args[0].fatal
    with qtbot.waitSignal(link.arrived, timeout=20_000):
        link.ask(wish(5))


def test_a_process_that_always_dies_is_given_up(link: RenderLink, qtbot: QtBot) -> None:
    troubles = []
    link.troubled.connect(troubles.append)
    link.ask(wish(1))
    link.open(demo_room.RoomSource(crash=1))
    qtbot.waitUntil(lambda: bool(troubles) and troubles[-1].fatal, timeout=40_000)
    assert len(troubles) == 3


def test_closing_ends_the_process(link: RenderLink, qtbot: QtBot) -> None:
    link.open(demo_room.RoomSource(burn=5.0))
    qtbot.wait(300)
    pid = link.process_id
    link.close()
    assert pid is not None and not psutil.pid_exists(pid)
    link.close()


def test_heavy_drawing_is_not_felt_in_the_window(link: RenderLink, qtbot: QtBot) -> None:
    """Views that compute for 600 ms each: drawn in the window, every one would keep its loop away for as long."""
    link.open(demo_room.RoomSource(burn=0.6))
    qtbot.waitUntil(lambda: link.ready, timeout=20_000)
    probe, count = GapRecorder(), []
    link.arrived.connect(count.append)
    probe.start()
    for i in range(8):
        pose = ViewPose((7.0, 4.5, 1.5), tau * i / 8)
        with qtbot.waitSignal(link.arrived, timeout=10_000):
            link.ask(Request(i, pose.camera(480, 270), "rgb", True))
    probe.stop()
    assert len(count) == 8
    # A busy machine may stop any program for as long, but not at every view.
    assert sum(gap > 300 for gap in probe.gaps) < 3, f"longest gap {probe.longest:.0f} ms"
