"""A user is asked on a real terminal, in the middle of a display that shows progress."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import textwrap
import time

import pytest

PROGRAM = textwrap.dedent("""
    from nvsim.cli.consent import ask_for_consent
    from nvsim.cli.console import event_listener
    from nvsim.endpoint.options import Endpoint
    from nvsim.endpoint.budget import Prices
    from nvsim.endpoint.budget import RequestEstimate
    from nvsim.errors import InputError
    from nvsim.events import Progress
    here = Endpoint.of("http://localhost/v1", "seer")
    with event_listener(False) as listen:
        listen(Progress("judge", 1, 4))
        try:
            estimate = RequestEstimate(3, 6, 2_000_000, 900, 300)
            print("agreed", ask_for_consent([(here, estimate, Prices(1.0, 2.0))], ["A note."], False))
        except InputError as error:
            print("refused", error)
        listen(Progress("judge", 4, 4))
""")


@pytest.mark.parametrize(("answer", "found"), [(b"y\n", "agreed True"), (b"\n", "refused Nothing was sent")])
def test_the_question_stands_on_the_screen_before_the_answer(answer: bytes, found: str) -> None:
    ours, theirs = pty.openpty()
    process = subprocess.Popen([sys.executable, "-c", PROGRAM], stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    out, answered, until = b"", False, time.monotonic() + 60
    try:
        while time.monotonic() < until:
            if not select.select([ours], [], [], 0.5)[0]:
                continue
            try:
                data = os.read(ours, 4096)
            except OSError:  # the other end is closed
                break
            out += data
            if b"[y/N]" in out and not answered:
                os.write(ours, answer)
                answered = True
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    text = out.decode()
    assert "To seer at http://localhost/v1 (without a key): 3 requests with 6 images, 2.0 MB" in text
    assert answered and "A note." in text and found in text
