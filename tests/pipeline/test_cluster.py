"""Pieces of work on a real Ray cluster of this machine: two cores, a token, and workers that die."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cluster_work
import pytest

from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.cluster.piece import Executor, Message, SentFile, StorageNotShared, Work, WorkCall, WorkItem, WorkResult
from nvsim.errors import InputError
from nvsim.events import Log, Warning, Worker

MIB = 1 << 20


@pytest.fixture(scope="module")
def executor(ray_head: str) -> Iterator[Executor]:
    with open_executor(ClusterConfig("ray", ray_head)) as found:
        yield found


def pieces(count: int, cores: int = 1, size: int = 50 * MIB) -> list[WorkItem]:
    return [WorkItem("sums", i, f"sum {i}", cores, size) for i in range(count)]


def done(executor: Executor, ordered: list[WorkItem], work: Work, *given: object) -> list[tuple[int, Message]]:
    return [(p.part, m) for p, m in executor.run(ordered, lambda piece: WorkCall(work, given))]


def values(told: list[tuple[int, Message]]) -> dict[int, object]:
    return {part: m.value for part, m in told if isinstance(m, WorkResult)}


def test_every_piece_is_done_once_and_what_it_says_is_heard(executor: Executor) -> None:
    told = done(executor, pieces(5), cluster_work.add, 2, 3)
    found = values(told)
    assert sorted(found) == list(range(5))
    sums = [v for v in found.values() if isinstance(v, tuple)]
    assert {(total, threads) for total, threads, _ in sums} == {(5, 1)}
    assert len({process for _, _, process in sums}) <= 3  # they are used again, with their kernels
    assert sum(m == Log("said aside", "sums") for _, m in told) == 5
    states = [(part, m.state) for part, m in told if isinstance(m, Worker)]
    assert sorted(states) == sorted((i, state) for i in range(5) for state in ("works", "ended"))
    assert executor.machines == (2,)
    assert executor.remote


def test_a_user_mistake_is_a_sentence_and_ours_a_traceback(executor: Executor) -> None:
    with pytest.raises(InputError, match="There is no such sum"):
        done(executor, pieces(1), cluster_work.refuse)
    with pytest.raises(RuntimeError, match="ZeroDivisionError: ours"):
        done(executor, pieces(1), cluster_work.break_down)


def test_a_piece_that_lacked_memory_begins_again_with_twice_as_much(executor: Executor) -> None:
    told = done(executor, pieces(1, size=100 * MIB), cluster_work.need_memory, 150 * MIB)
    assert values(told) == {0: 200 * MIB}
    assert any(isinstance(m, Warning) and "memory ran out" in m.text for _, m in told)


def test_a_killed_worker_is_replaced_and_begin_is_asked_again(executor: Executor, tmp_path: Path) -> None:
    asked = []

    def begin(piece: WorkItem) -> WorkCall:
        asked.append(piece.part)
        return WorkCall(cluster_work.die, (tmp_path, 4, True))  # more often than it may without getting further

    told = [(p.part, m) for p, m in executor.run(pieces(1), begin)]
    assert values(told) == {0: 4}
    assert asked == [0] * 5
    assert sum(isinstance(m, Worker) and m.state == "lost" for _, m in told) == 4


def test_a_piece_that_loses_every_worker_at_the_same_place_is_given_up(executor: Executor, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="lost its worker 3 times"):
        done(executor, pieces(1), cluster_work.die, tmp_path, 9, False)


def test_what_does_not_see_the_files_is_ordered_anew_and_files_come_back(executor: Executor, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"1" * 1000)
    told: list[Message] = []

    def begin(piece: WorkItem) -> WorkCall:
        return WorkCall(cluster_work.send_back, (path, any(isinstance(m, StorageNotShared) for m in told)))

    for _, message in executor.run(pieces(1), begin):
        told.append(message)
    files = [m for m in told if isinstance(m, SentFile)]
    assert [f.data for f in files] == [b"1" * 1000]
    files[0].check()
    with pytest.raises(InputError, match="damaged on its way"):
        SentFile("x", b"2", files[0].sha256).check()


def test_who_stops_listening_stops_the_workers(executor: Executor, tmp_path: Path) -> None:
    path = tmp_path / "count"
    with closing(executor.run(pieces(1), lambda piece: WorkCall(cluster_work.count_slowly, (path,)))) as told:
        next(m for _, m in told if isinstance(m, Log))
    before = path.read_text()
    time.sleep(0.5)
    assert path.read_text() == before
