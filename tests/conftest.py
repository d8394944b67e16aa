"""Fixtures that every test may use."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing.process import BaseProcess
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

REPOSITORY = Path(__file__).resolve().parents[1]
FAST = {
    *("atomic", "reading", "stored_arrays", "events"),
    *("docstrings", "first_changes", "import_contracts"),
    *("geometry", "geometry_camera_path", "geometry_lens", "geometry_rotation"),
    *("capture_clouds", "capture_images", "capture_multi", "capture_readers", "capture_store"),
    *("mapping_corridor", "mapping_edge_doubts", "mapping_explain", "one_decision"),
    *("graph_compare", "graph_edit_families", "graph_exports", "graph_findings"),
    *("graph_connectivity", "graph_edits", "graph_history", "graph_journal", "graph_selection", "graph_storeys"),
}
"""Of tests/unit, the files that compile no kernel and open no window: `pytest -m fast`."""
STARTS_PROCESSES = {
    "test_a_killed_write_leaves_the_old_file",
    "test_a_killed_process_leaves_the_journal_to_the_next",
    "test_a_kill_in_the_middle_of_trimming_loses_nothing",
    "test_a_criterion_in_two_files_is_in_the_commands_and_in_the_window",
}
TAKES_SECONDS = {
    "test_reader_gives_a_graph_or_a_sentence",
    "test_any_damage_to_a_floor_surface_is_a_surface_or_a_sentence",
    "test_a_trimmed_journal_gives_its_room_back",
}
"""Of these files, the tests that are left out of it."""

# How long an example takes says how busy the machine is.
settings.register_profile("unhurried", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("unhurried")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """`-m fast` reads no other file: importing them all takes longer than its tests."""
    if config.option.markexpr != "fast":
        return None
    if collection_path.parent == REPOSITORY / "tests":
        return collection_path.name != "unit"
    unit = collection_path.parent == REPOSITORY / "tests" / "unit"
    return True if unit and collection_path.stem.removeprefix("test_") not in FAST else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if hasattr(config, "workerinput"):  # a process of pytest-xdist
        # The slowest files first, so that no process has one left when the others are at the end.
        items.sort(key=lambda item: (item.path.parent.name != "pipeline", item.path.stem != "test_tutorials_run"))
    for item in items:
        named = item.path.parent.name == "unit" and item.path.stem.removeprefix("test_") in FAST
        if named and getattr(item, "originalname", item.name) not in STARTS_PROCESSES | TAKES_SECONDS:
            item.add_marker("fast")


@pytest.fixture(autouse=True)
def fast_tests_start_no_process(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.node.get_closest_marker("fast") is not None:
        monkeypatch.setattr(subprocess.Popen, "__init__", _refuse)
        monkeypatch.setattr(BaseProcess, "start", _refuse)


def _refuse(*_: object, **__: object) -> None:
    pytest.fail("a test that starts a process is not fast: name it in STARTS_PROCESSES")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real captures beside the repository; its absence is an error on CI and a skip elsewhere."""
    folder = Path(os.environ.get("NVSIM_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        if os.environ.get("CI") == "true":
            pytest.fail(f"the real captures are missing: {folder}")
        pytest.skip(f"the real captures are not here: {folder} (set NVSIM_DATA to their folder)")
    return folder


@pytest.fixture(scope="session", autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tests and their child processes keep their secret in a folder of their own, not in the user's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(scope="session")
def ray_head() -> Iterator[str]:
    """The address of a Ray cluster of this machine with two cores, with a token of its own."""
    if importlib.util.find_spec("ray") is None:  # imported later: it reads the environment when it is
        pytest.skip("Ray is not installed")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    short = Path(tempfile.mkdtemp(prefix="nvr-", dir="/tmp"))  # names of sockets have little room
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_AUTH_MODE", "token")
        patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        paths = os.pathsep.join([*filter(None, sys.path), str(REPOSITORY / "tests" / "pipeline")])
        command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", f"--port={port}", "--num-cpus=2",
                   "--include-dashboard=false", "--object-store-memory=100000000", "--block",
                   f"--temp-dir={short}"]  # fmt: skip
        with open(short / "head.log", "wb") as log:
            head = subprocess.Popen(
                command, env={**os.environ, "PYTHONPATH": paths}, stdout=log, stderr=log, start_new_session=True
            )
        try:
            _wait_for(short / "head.log", head)
            yield f"127.0.0.1:{port}"
        finally:
            head.terminate()
            try:
                head.wait(20)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(head.pid, signal.SIGKILL)
                shutil.rmtree(short, ignore_errors=True)


def _wait_for(log: Path, head: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + 180  # on a machine with other work
    while "block forever" not in log.read_text():
        if head.poll() is not None or time.monotonic() > until:
            pytest.fail(f"Ray did not start: {log.read_text()[-2000:]}")
        time.sleep(0.1)
