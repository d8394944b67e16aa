"""The distribution of work over machines, the limit of retries, and the messages if there is no cluster."""

from __future__ import annotations

import importlib.util
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from nvsim.cli.main import main
from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.cluster.piece import WorkItem, pieces_at_once, threads_each
from nvsim.cluster.ray_pool import Attempt
from nvsim.cluster.storage import StorageProbe
from nvsim.cluster.versions import versions
from nvsim.errors import InputError
from nvsim.events import Progress

GB = 1_000_000_000
PIECE = WorkItem("train", 3, "submap 3", 2, 2 * GB)


@pytest.mark.parametrize(
    ("machines", "pieces", "expected"),
    [((2,), 4, 1), ((8, 8, 8), 4, 4), ((8, 8), 2, 8), ((16, 4), 3, 5), ((1, 1), 1, 1), ((), 3, 1)],
)
def test_all_pieces_run_at_once_with_as_many_threads_as_that_leaves(
    machines: tuple[int, ...], pieces: int, expected: int
) -> None:
    found = threads_each(machines, pieces)
    assert found == expected
    if sum(machines) >= pieces:
        assert pieces_at_once(machines, found) >= pieces > pieces_at_once(machines, found + 1) or found == max(machines)


def test_memory_is_doubled_for_who_was_killed_for_it_up_to_the_largest_machine() -> None:
    attempt = Attempt(PIECE, PIECE.bytes)
    assert "4.0 GB" in attempt.prepare_restart(True, 7 * GB)
    assert "7.0 GB" in attempt.prepare_restart(True, 7 * GB)
    with pytest.raises(InputError, match="no machine has more"):
        attempt.prepare_restart(True, 7 * GB)


def test_losses_count_in_a_row_only() -> None:
    attempt = Attempt(PIECE, PIECE.bytes)
    for step in range(1, 6):
        attempt.record_message(Progress("train", step, 10))
        attempt.prepare_restart(False, GB)
    attempt.prepare_restart(False, GB)
    attempt.record_message(Progress("train", 3, 10))  # it was there before
    with pytest.raises(InputError, match="without progress"):
        attempt.prepare_restart(False, GB)


def test_a_machine_without_the_same_files_says_what_it_lacks(tmp_path: Path) -> None:
    image = tmp_path / "images" / "a.jpg"
    image.parent.mkdir()
    image.write_bytes(b"123")
    probe = StorageProbe.create_in(tmp_path / "project", image)
    assert probe.missing() == ""
    assert replace(probe, word="another").missing() == str(tmp_path / "project")
    image.write_bytes(b"1234")
    assert probe.missing() == str(image)
    probe.remove()
    assert probe.missing() == str(tmp_path / "project")
    assert list((tmp_path / "project").iterdir()) == []


def test_versions_tell_sources_apart() -> None:
    assert set(versions()) >= {"NVSim", "Python", "numba", "numpy", "torch"}
    assert "sources" in versions()["NVSim"]


def test_without_the_extra_one_sentence_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert main(["train", "--project", str(tmp_path), "--executor", "ray"]) == 2
    assert capsys.readouterr().err.count("nvsim[cluster]") == 1


@pytest.mark.parametrize("address", ["ray://host:10001", "host", "host:0", "host:x", ":6379", "a/b:1"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="HOST:PORT"), open_executor(ClusterConfig("ray", address)):
        pass


def test_an_address_where_nothing_answers_is_a_sentence_in_bounded_time() -> None:
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed")
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    started = time.monotonic()
    with (
        pytest.raises(InputError, match="Nothing answers at"),
        open_executor(ClusterConfig("ray", f"127.0.0.1:{port}")),
    ):
        pass
    assert time.monotonic() - started < 20


def test_ray_is_imported_where_it_is_asked_for_and_nowhere_else() -> None:
    program = (
        "import sys, nvsim.cli.commands.stages, nvsim.cli.commands.run, nvsim.cluster.ray_pool\n"
        "from nvsim.cluster.executor_choice import open_executor\nfrom nvsim.cluster.config import ClusterConfig\n"
        "with open_executor(ClusterConfig()): sys.exit('ray' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0
