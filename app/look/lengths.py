"""Lengths as a user reads them: in metres or in feet. Everything is computed, stored and entered in metres; who shows a
length writes it with these, and again when `Document.unitsChanged` says so. Knows no Qt."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Unit:
    """symbol    behind a figure
    word      at the beginning of a sentence
    metres    of one
    """

    symbol: str
    word: str
    metres: float


UNITS = {"metres": Unit("m", "Metres", 1.0), "feet": Unit("ft", "Feet", 0.3048)}
_chosen = [UNITS["metres"]]


def choose(name: str) -> None:
    """Writes lengths in this unit from now on. Raises KeyError where it is none of UNITS."""
    _chosen[0] = UNITS[name]


def unit() -> Unit:
    """The one in use."""
    return _chosen[0]


def figure(metres: float, decimals: int = 2, sign: bool = False) -> str:
    """Without its unit."""
    return f"{metres / unit().metres:{'+' if sign else ''}.{decimals}f}"


def length(metres: float, decimals: int = 2, sign: bool = False) -> str:
    """With its unit."""
    return f"{figure(metres, decimals, sign)} {unit().symbol}"


def place(*metres: float, decimals: int = 2) -> str:
    """Coordinates, with their unit behind the last."""
    return f"{', '.join(figure(value, decimals) for value in metres)} {unit().symbol}"
