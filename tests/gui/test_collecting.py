"""Python's collector in the window: nothing is walked through while the person works, and nothing is kept for ever."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterator

import pytest
from pytestqt.qtbot import QtBot

from nvsim_app.start import application
from nvsim_app.start.application import Collecting


class Knot:
    """Something that only the collector can free."""

    def __init__(self) -> None:
        self.me = self


@pytest.fixture
def moving() -> list[bool]:
    return [False]


@pytest.fixture
def kept(qtbot: QtBot, moving: list[bool]) -> Iterator[Collecting]:
    made = Collecting(lambda: moving[0])
    yield made
    made.stop()
    made.deleteLater()


@pytest.fixture
def walks() -> Iterator[list[int]]:
    """The generation of every walk of the collector."""
    seen: list[int] = []

    def note(phase: str, info: dict[str, int]) -> None:
        if phase == "start":
            seen.append(info["generation"])

    gc.callbacks.append(note)
    yield seen
    gc.callbacks.remove(note)


def made(count: int) -> Callable[[], int]:
    """The length of so many new objects, which live as long as this is kept."""
    return [[] for _ in range(count)].__len__


def test_nothing_is_walked_through_while_much_is_read(kept: Collecting, walks: list[int]) -> None:
    keep = made(3 * application.MANY)
    assert walks == []
    kept.collect_if_idle()
    assert walks == [] and gc.get_freeze_count() > keep()  # put aside, not walked through


def test_young_circles_are_freed_also_while_the_picture_moves(
    kept: Collecting, moving: list[bool], walks: list[int]
) -> None:
    moving[0] = True
    gone = weakref.ref(Knot())
    keep = made(2 * application.YOUNG)
    kept.collect_if_idle()
    assert gone() is None and keep() and 2 not in walks


def test_everything_is_looked_at_only_while_nothing_moves(
    kept: Collecting, moving: list[bool], walks: list[int]
) -> None:
    moving[0] = True
    for _ in range(2 * application.THOROUGH):
        kept.collect_if_idle()
    assert 2 not in walks
    moving[0] = False
    kept.collect_if_idle()
    assert 2 in walks


def test_what_a_closed_project_left_in_circles_is_freed(kept: Collecting, qtbot: QtBot) -> None:
    gone = weakref.ref(Knot())
    keep = made(2 * application.MANY)
    kept.collect_if_idle()
    assert gone() is not None and keep()  # aside
    kept.begin_anew()
    qtbot.waitUntil(lambda: gone() is None, timeout=20_000)


def test_the_collector_runs_by_itself_again_afterwards(qtbot: QtBot) -> None:
    kept = Collecting(lambda: False)
    assert not gc.isenabled()
    kept.stop()
    assert gc.isenabled() and gc.get_freeze_count() == 0
