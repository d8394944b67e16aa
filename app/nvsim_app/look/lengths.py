"""Formats lengths for display in meters or feet. All lengths are computed, stored, and entered in meters.

Widgets format lengths with these functions, and format them again after `Document.unitsChanged`. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Unit:
    """A unit of length.

    symbol    symbol after a number
    word      name with a capital letter
    meters    meters per unit
    """

    symbol: str
    word: str
    meters: float


UNITS = {"metres": Unit("m", "Meters", 1.0), "feet": Unit("ft", "Feet", 0.3048)}
_chosen = [UNITS["metres"]]


def choose(name: str) -> None:
    """Sets the unit of displayed lengths. Raises KeyError if `name` is not in UNITS."""
    _chosen[0] = UNITS[name]


def unit() -> Unit:
    """The current unit."""
    return _chosen[0]


def figure(meters: float, decimals: int = 2, sign: bool = False) -> str:
    """Formats a length without its unit."""
    return f"{meters / unit().meters:{'+' if sign else ''}.{decimals}f}"


def length(meters: float, decimals: int = 2, sign: bool = False) -> str:
    """Formats a length with its unit."""
    return f"{figure(meters, decimals, sign)} {unit().symbol}"


def position_text(*meters: float, decimals: int = 2) -> str:
    """Formats coordinates with their unit after the last one."""
    return f"{', '.join(figure(value, decimals) for value in meters)} {unit().symbol}"
