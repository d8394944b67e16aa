"""A real window on an X server: the one of DISPLAY, else an Xvfb of our own. Where there is neither, these tests are
skipped, and on CI they fail."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "gui"))


@pytest.fixture(scope="session")
def opengl() -> None:
    """That OpenGL works without a window."""
    from nvsim.errors import InputError
    from nvsim.render.opengl.renderer import standalone_context

    try:
        standalone_context().release()
    except InputError as error:
        if os.environ.get("CI") == "true":
            pytest.fail(str(error))
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """The name of a display, for the environment of the program under test."""
    existing = os.environ.get("DISPLAY")
    if existing:
        yield existing
        return
    server = shutil.which("Xvfb")
    if server is None:
        reason = "there is no DISPLAY and no Xvfb; install xvfb (packaging lists the system packages)"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    read, write = os.pipe()
    process = subprocess.Popen(
        [server, "-displayfd", str(write), "-screen", "0", "1600x1000x24", "-nolisten", "tcp"],
        pass_fds=(write,),
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            number = answer.readline().strip()  # it is written when the server accepts connections
        assert number, "Xvfb ended before it was ready"
        yield f":{number}"
    finally:
        process.terminate()
        process.wait(10)
