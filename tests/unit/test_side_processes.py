"""Only one folder of the window starts processes, and one call ends them."""

from __future__ import annotations

import ast
import os
import re
import signal
import time
from pathlib import Path

import psutil
import pytest

from nvsim.errors import InputError
from nvsim_app.processes.child import Child, ChildProgram
from nvsim_app.processes.serving import EndMessage, Requests, short_reason

ROOT = Path(__file__).parents[2]
STARTERS = {"subprocess", "QProcess", "Popen", "pty"}
SHORT_STARTERS = {"os.system", "os.fork", "os.posix_spawn", "QProcess.startDetached", "multiprocessing.get_context"}
WORDS = re.compile(rf"\b({'|'.join(name.rpartition('.')[2] for name in STARTERS | SHORT_STARTERS)})\b")
"""Every module that starts a process has one of these words."""
COMMANDS = {
    "nvsim/cli/commands/bench_window.py",
    "nvsim/cli/commands/app.py",
    "nvsim/cli/worker.py",  # jobs, which outlive the window
    "nvsim/r2r/simulator/shim/__init__.py",
}
"""Modules that run one command and wait for its end, or start a job."""


def test_one_module_starts_processes_with_a_pipe() -> None:
    found = set()
    for path in [*(ROOT / "nvsim").rglob("*.py"), *(ROOT / "app" / "nvsim_app").rglob("*.py")]:
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if WORDS.search(text) else ():
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            starts = bool(STARTERS & {part for name in names for part in name.split(".")})
            starts |= isinstance(node, ast.Attribute) and ast.unparse(node) in SHORT_STARTERS
            if starts:
                found.add(path.relative_to(ROOT).as_posix())
    assert found - COMMANDS == {"nvsim/processes/process.py"} and found >= COMMANDS


def _double(requests: Requests, number: int) -> int:
    return 2 * number


def _refuse(requests: Requests, path: Path) -> None:
    raise InputError(f"{path} is no map.")


def _break(requests: Requests, source: object) -> None:
    raise EOFError("the file ends early")


def _break_like_a_compiler(requests: Requests, source: object) -> None:
    raise ValueError("Failed in the pipeline.\nTraceback (most recent call last):\n  File x.py, line 3\n")


def _crash(requests: Requests, source: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _fill_memory(requests: Requests, source: object) -> int:
    return len(bytearray(1 << 30))


def _wait(requests: Requests, source: object) -> None:
    requests.send_notice(os.getpid())
    time.sleep(60)


def test_a_child_returns_the_result_of_its_work() -> None:
    assert Child(ChildProgram(_double, "double", "It fails"), 21).result() == 42


@pytest.mark.parametrize(
    ("work", "sentence"),
    [
        (_refuse, "x is no map."),
        (_break, "It fails: unexpected error (the file ends early)."),
        (_break_like_a_compiler, "It fails: unexpected error (Failed in the pipeline)."),
        (_crash, "It fails: its process ended with code -9."),
        (_fill_memory, "It fails: it needs more than 0.27 GB of memory."),
    ],
)
def test_why_a_child_fails_is_one_sentence(work, sentence: str) -> None:
    if work is _fill_memory and not psutil.LINUX:
        pytest.skip("only Linux limits memory")
    heard: list[object] = []
    child = Child(
        ChildProgram(work, "work", "It fails", memory=1 << 28), Path("x"), lambda child, message: heard.append(message)
    )
    with pytest.raises(InputError) as error:
        child.result()
    assert str(error.value) == sentence
    (end,) = heard
    assert isinstance(end, EndMessage) and end.crashed == (work is _crash)
    assert ("Traceback" in end.trace) == (work in (_break, _break_like_a_compiler))


def test_a_child_that_is_killed_gives_no_result() -> None:
    heard: list[object] = []
    child = Child(ChildProgram(_wait, "wait", "It fails"), None, lambda child, message: heard.append(message))
    while not heard:
        time.sleep(0.01)
    process = child.process_id
    child.kill()
    assert child.result() is None and len(heard) == 1
    child.end()
    assert process is not None and not psutil.pid_exists(process) and child.process_id is None
    early = Child(ChildProgram(_wait, "wait", "It fails"), None)
    early.end()
    assert early.result() is None


def test_a_reason_is_one_line_without_python_words() -> None:
    assert short_reason(InputError("x is no map.")) == "x is no map."
    assert short_reason(ValueError("Failed.\n\nTraceback:\n  File x.py")) == "unexpected error (Failed)."
    assert short_reason(KeyError("means")) == "unexpected error (KeyError)."
    assert len(short_reason(ValueError("long " * 1000))) < 200
