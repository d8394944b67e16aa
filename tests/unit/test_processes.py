"""A child process answers, and the caller gets one sentence about its failure."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from obedient_child import Obedient

from nvsim.errors import InputError
from nvsim.processes import child as processes
from nvsim.processes.child import Child, Limits
from nvsim.processes.process import PipedProcess
from nvsim.processes.serving import answer_requests


def end_all() -> None:
    """Ends every child of this process that waits."""
    while processes._idle:
        processes._idle.popitem()[1].end()


@pytest.fixture
def child():
    made: Child = Child(Obedient, "x.h5", "write it again")
    yield made
    made.close()
    end_all()


def ended(pid: int) -> bool:
    with contextlib.suppress(ChildProcessError):
        # A process whose main thread is a zombie may still have other threads, and its parent does not see its end.
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


def gone(pid: int) -> bool:
    end = time.monotonic() + 20
    while not ended(pid):
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def test_arrays_come_back_as_they_went_and_can_be_written(child) -> None:
    given = [np.arange(12.0).reshape(3, 4), np.asfortranarray(np.ones((3, 2))), np.empty((0, 4)), np.arange(9)[::2]]
    first, second = child.ask(("twice", given))
    for array, one, other in zip(given, first, second, strict=True):
        np.testing.assert_array_equal(array, one)
        np.testing.assert_array_equal(array, other)
        one[...] = 0


def test_a_refusal_passes_and_the_child_goes_on(child) -> None:
    pid = child.ask(("pid",))
    with pytest.raises(InputError, match="No; ask for another."):
        child.ask(("refuse",))
    assert child.ask(("pid",)) == pid != os.getpid()


def test_notices_come_in_order_before_the_answer(child) -> None:
    heard: list[object] = []
    assert child.ask(("tell", [1, "two", 3.0]), hear=heard.append) == "told"
    assert heard == [1, "two", 3.0]
    assert child.ask(("tell", [4])) == "told" and heard == [1, "two", 3.0]


def test_an_error_of_the_listener_ends_the_child_and_is_passed_on(child) -> None:
    def refuse(value: object) -> None:
        raise BrokenPipeError("the reader is gone")

    pid = child.ask(("pid",))
    with pytest.raises(BrokenPipeError, match="the reader is gone"):
        child.ask(("tell", [1]), hear=refuse)
    assert gone(pid)


def test_a_process_that_ended_while_it_waited_is_not_used_again() -> None:
    with Child(Obedient, "x.h5", "write it again") as first:
        pid = first.ask(("pid",))
    os.kill(pid, signal.SIGKILL)
    assert gone(pid)
    with Child(Obedient, "x.h5", "write it again") as second:
        assert second.ask(("pid",)) != pid
    end_all()


def test_a_fault_of_ours_is_no_fault_of_the_file(child) -> None:
    with pytest.raises(RuntimeError, match="ZeroDivisionError: ours"):
        child.ask(("mistake",))


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGBUS", "SIGABRT", "SIGKILL"])
def test_a_crash_is_a_sentence_with_file_signal_and_fix(child, name: str) -> None:
    with pytest.raises(InputError, match=f"x.h5 crashed the program that reads it .{name}.*; write it again."):
        child.ask(("signal", getattr(signal, name)))
    with pytest.raises(InputError, match="has ended"):
        child.ask(("pid",))


def test_an_answer_that_does_not_come_in_time_is_a_sentence_and_the_child_ends(child) -> None:
    pid = child.ask(("pid",))
    with pytest.raises(InputError, match="x.h5 gives no answer within 1 s; write it again."):
        child.ask(("loop",), Limits(seconds=1))
    assert gone(pid)


def test_a_child_that_computes_for_too_long_ends_before_the_time_is_up(child) -> None:
    pid = child.ask(("pid",))
    with pytest.raises(InputError, match="x.h5 gives no answer within 0.5 s; write it again."):
        child.ask(("loop",), Limits(seconds=60, computing=0.5))
    assert gone(pid)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to a limit of memory")
def test_memory_beyond_the_limit_is_a_sentence_and_the_child_goes_on(child) -> None:
    with pytest.raises(InputError, match="x.h5 needs more than 0.1 GB of memory; write it again."):
        child.ask(("hold", 400_000_000), Limits(memory=100_000_000))
    assert child.ask(("hold", 400_000_000)) == 400_000_000


def test_a_released_process_serves_the_next_child(child) -> None:
    pid = child.ask(("pid",))
    child.release()
    after: Child = Child(Obedient, "y.h5", "write it again")
    assert after.ask(("pid",)) == pid
    other: Child = Child(Obedient, "z.h5", "write it again")
    assert other.ask(("pid",)) != pid
    for one in (after, other):
        one.close()
    assert gone(pid)


def test_close_in_another_thread_ends_an_endless_request(child) -> None:
    child.ask(("pid",))
    threading.Timer(0.3, child.close).start()
    with pytest.raises(InputError, match="x.h5 crashed the program"):
        child.ask(("loop",))


def test_two_threads_that_end_a_process_close_its_pipe_once(monkeypatch) -> None:
    process = PipedProcess(answer_requests, "obedient_child:Obedient")
    wait, close, closed = process._process.wait, process._close, []
    monkeypatch.setattr(process._process, "wait", lambda: (time.sleep(0.2), wait()))
    monkeypatch.setattr(process, "_close", lambda: (closed.append(1), close()))
    threads = [threading.Thread(target=process.end) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert closed == [1]


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_a_child_that_never_returns_ends_with_its_caller(tmp_path: Path, name: str) -> None:
    code = (
        "import sys; sys.path[:0] = sys.argv[1:2]\n"
        "from obedient_child import Obedient; from nvsim.processes.child import Child\n"
        "child = Child(Obedient, 'x', 'y'); print(child.ask(('pid',)), flush=True); child.ask(('loop',))"
    )
    caller = subprocess.Popen(
        [sys.executable, "-c", code, str(Path(__file__).parent)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert caller.stdout is not None
    pid = int(caller.stdout.readline())
    time.sleep(0.2)
    caller.send_signal(getattr(signal, name))
    assert caller.wait(20) != 0 and gone(pid)
    caller.stdout.close()
