"""Nothing is sent before a user was told what, how much and at what price, and agreed."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from nvsim.cli.console import paused
from nvsim.cli.terminal import say
from nvsim.endpoint.address import Endpoint
from nvsim.endpoint.budget import Prices
from nvsim.endpoint.estimate import Outlay
from nvsim.errors import InputError


def agree(asked: Sequence[tuple[Endpoint, Outlay, Prices]], notes: Sequence[str], yes: bool) -> bool:
    """Says on stderr what is sent to whom, with `notes`, and asks unless `yes`. Where all answers are kept
    nobody is asked. Returns whether anything may be sent. Raises InputError where the user says no, or cannot be asked.
    """
    with paused():
        return _agreed(asked, notes, yes)


def _agreed(asked: Sequence[tuple[Endpoint, Outlay, Prices]], notes: Sequence[str], yes: bool) -> bool:
    for endpoint, outlay, prices in asked:
        say(f"To {endpoint.words}: {outlay.words(prices)}.", error=True)
    if not any(outlay.requests for _, outlay, _ in asked):
        return yes
    for note in notes:
        say(note, error=True)
    sys.stderr.flush()
    if yes:
        return True
    if not sys.stdin.isatty():
        raise InputError("Nothing was sent, as nobody can be asked here; give --yes to send it.")
    print("Send this? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError("Nothing was sent; run the command again to send it.")
    return True
