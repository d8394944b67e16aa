"""Ask for consent before anything is sent to an endpoint: the user sees the content, the amount, and the price."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from nvsim.cli.console import without_progress_bars
from nvsim.cli.terminal import print_lines
from nvsim.endpoint.budget import Prices, RequestEstimate
from nvsim.endpoint.options import Endpoint
from nvsim.errors import InputError


def ask_for_consent(asked: Sequence[tuple[Endpoint, RequestEstimate, Prices]], notes: Sequence[str], yes: bool) -> bool:
    """Prints on stderr what is sent to each endpoint, with `notes`, and asks for consent unless `yes`. Does not ask if
    all answers are stored. Returns whether requests may be sent. Raises InputError if the user declines, or if there is
    no terminal to ask on.
    """
    with without_progress_bars():
        return _ask_user(asked, notes, yes)


def _ask_user(asked: Sequence[tuple[Endpoint, RequestEstimate, Prices]], notes: Sequence[str], yes: bool) -> bool:
    for endpoint, estimate, prices in asked:
        print_lines(f"To {endpoint.words}: {estimate.words(prices)}.", error=True)
    if not any(estimate.requests for _, estimate, _ in asked):
        return yes
    for note in notes:
        print_lines(note, error=True)
    sys.stderr.flush()
    if yes:
        return True
    if not sys.stdin.isatty():
        raise InputError("Nothing was sent, because there is no terminal to ask for consent; give --yes to send it.")
    print("Send this? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError("Nothing was sent; run the command again to send it.")
    return True


def exit_code(unusable: Sequence[str]) -> int:
    """The exit code of a command that asked models: 1, with a sentence for each, if no answer of the models `unusable`
    was usable; else 0."""
    for model in unusable:
        print_lines(f"error: no answer of {model} was usable; the warnings above have the reasons.", error=True)
    return 1 if unusable else 0
