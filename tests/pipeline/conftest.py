"""Fixtures of the tests that take whole stages together."""

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
from pathlib import Path

import pytest

_REPOSITORY = Path(__file__).resolve().parents[2]


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
        paths = os.pathsep.join(map(str, (_REPOSITORY, Path(__file__).parent)))
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
    until = time.monotonic() + 60
    while "block forever" not in log.read_text():
        if head.poll() is not None or time.monotonic() > until:
            pytest.fail(f"Ray did not start: {log.read_text()[-2000:]}")
        time.sleep(0.1)
