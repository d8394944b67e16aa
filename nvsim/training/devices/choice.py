"""The device that a configuration names, as far as this machine has it."""

from __future__ import annotations

from nvsim.errors import InputError
from nvsim.render.backends import missing_for_gsplat


def card(device: str) -> str | None:
    """The card that `device` ("auto", "cpu" or "cuda") stands for here, as torch names it; None is the CPU. Raises
    InputError when a card is asked for and cannot be used."""
    if device == "cpu":
        return None
    missing = missing_for_gsplat()
    if missing is None:
        return "cuda"
    if device == "cuda":
        raise InputError(f"No card can be used here: {missing}. Take --device cpu.")
    return None
