"""Findings: problems of a capture with a place, a severity, and a consequence. They are collected, not raised."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

from nvsim.errors import InputError, value_text

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
SCALE_UNKNOWN = "the scale is unknown"
ASSUMED_HEIGHT = 1.5  # meters of the camera above the floor, if a video comes without a scale
SCALE_ASSUMED = f"the scale is assumed from a camera height of {ASSUMED_HEIGHT:g} m"
IMAGE_MISSING = "the image is missing"
IMAGE_AMBIGUOUS = "several folders hold an image of this name; name the right one with --images"
OTHER_MODELS = "the images are spread over several COLMAP models"
"""Messages of findings for which the program offers a specific fix."""
SCALE_IN_HEIGHTS = (
    f"lengths are in camera heights of {ASSUMED_HEIGHT:g} m; set --camera-height METERS or --known-length, or measure "
    "a known length in the window"
)
"""The consequence of `SCALE_ASSUMED`."""
_LISTED = 40
_LONGEST = 1000  # characters of a message
_KEPT = 5000  # findings of each severity, so that a file full of faults cannot exhaust the memory


@dataclass(frozen=True)
class Finding:
    """A problem or a fact about a capture.

    severity     "error": the capture is refused; "warning": usable with a drawback; "note": information
    message      the problem, worded identically for every place where it occurs
    where        file and line, or frame, or element
    consequence  the effect of the problem
    frames       names of the affected frames; leaving them out removes the finding
    fix          the option and value that remove the finding: "--axes opencv"
    """

    severity: Severity
    message: str
    where: str
    consequence: str
    frames: tuple[str, ...] = ()
    fix: str = ""

    def __str__(self) -> str:
        return f"{self.severity}: {self.message} ({self.where}): {self.consequence}"


class Findings:
    """A growing list of findings. Readers add to it, so they do not stop at the first problem."""

    def __init__(self) -> None:
        self._items: list[Finding] = []
        self._counts = {"error": 0, "warning": 0, "note": 0}

    def __iter__(self) -> Iterator[Finding]:
        yield from self._items
        for severity, count in self._counts.items():
            if count > _KEPT:
                yield Finding(
                    cast(Severity, severity),
                    f"there are {count - _KEPT} more findings like these",
                    "the whole capture",
                    "they are not listed",
                )

    def add(self, finding: Finding) -> None:
        self._counts[finding.severity] += 1
        if self._counts[finding.severity] <= _KEPT:
            self._items.append(replace(finding, message=value_text(finding.message, _LONGEST)))

    def error(self, message: str, where: str, consequence: str, frames: tuple[str, ...] = ()) -> None:
        self.add(Finding("error", message, where, consequence, frames))

    def warning(self, message: str, where: str, consequence: str, frames: tuple[str, ...] = ()) -> None:
        self.add(Finding("warning", message, where, consequence, frames))

    def note(self, message: str, where: str, consequence: str) -> None:
        self.add(Finding("note", message, where, consequence))

    def remove_places(self, places: frozenset[str]) -> None:
        """Remove the findings about `places`, which are left out of the capture."""
        kept = [f for f in self._items if f.where not in places]
        for finding in self._items:
            self._counts[finding.severity] -= finding.where in places
        self._items = kept

    @property
    def errors(self) -> tuple[Finding, ...]:
        return tuple(f for f in self._items if f.severity == "error")

    def raise_errors(self, source: Path) -> None:
        """Raises InputError with one sentence that lists every error and its places (at most 40 places of a kind)."""
        errors = self.errors
        if not errors:
            return
        kinds = []
        for kind in sorted(grouped(errors), key=lambda kind: -len(kind.places)):
            listed = ", ".join(value_text(place) for place in kind.places[:_LISTED])
            more = f" and {len(kind.places) - _LISTED} more" if len(kind.places) > _LISTED else ""
            kinds.append(f"{kind.message}{kind.count} ({listed}{more})")
        raise InputError(
            f"{source} cannot be used: {'; '.join(kinds)}; repair these and try again. "
            f"`nvsim check {source}` explains the effect of each."
        )


@dataclass(frozen=True)
class FindingGroup:
    """Equal findings at several places: severity and message, the consequence at the first place, all places, the names
    of all affected frames, and the option that fixes the first finding."""

    severity: Severity
    message: str
    consequence: str
    places: tuple[str, ...]
    frames: tuple[str, ...]
    fix: str = ""

    @property
    def count(self) -> str:
        """Text that follows the message if there are several places."""
        return f", {len(self.places)} times" if len(self.places) > 1 else ""

    def sentence(self, most: int | None = None) -> str:
        """One line with at most `most` places; with all places if it is None."""
        listed = self.places if most is None else self.places[:most]
        left = len(self.places) - len(listed)
        more = f" and {left} more" if left else ""
        places = "; ".join(value_text(place, _LONGEST) for place in listed)
        return f"{self.severity}: {self.message}{self.count}: {places}{more} ({self.consequence})"


def grouped(findings: Iterable[Finding]) -> tuple[FindingGroup, ...]:
    """Findings grouped by severity and message, in order of first occurrence."""
    kinds: dict[tuple[Severity, str], list[Finding]] = {}
    for finding in findings:
        kinds.setdefault((finding.severity, finding.message), []).append(finding)
    return tuple(
        FindingGroup(
            severity,
            message,
            found[0].consequence,
            tuple(f.where for f in found),
            tuple(dict.fromkeys(name for f in found for name in f.frames)),
            found[0].fix,
        )
        for (severity, message), found in kinds.items()
    )
