"""What is wrong with a capture: findings with a place, a severity and a consequence, collected rather than thrown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

from nvsim.errors import InputError

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
_LISTED = 40
_LONGEST = 1000  # characters of a message
_KEPT = 5000  # of each severity: a file of nothing but faults must not fill the memory


def shown(text: object, most: int = 300) -> str:
    """`text` escaped and shortened for a sentence: a name from a file may be endless or hold control sequences."""
    words = str(text)
    if not words.isprintable():
        words = words.encode("unicode_escape").decode()
    return words if len(words) <= most else words[: most - 3] + "..."


@dataclass(frozen=True)
class Finding:
    """One thing that a user should know about a capture.

    severity     "error": the capture is refused; "warning": it can be used, at a price; "note": good to know
    message      what is the matter, the same words for every place where it happens
    where        file and line, or frame, or element
    consequence  what it would cause
    """

    severity: Severity
    message: str
    where: str
    consequence: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.message} ({self.where}): {self.consequence}"


class Findings:
    """A growing list of findings, handed through a reader so that it need not stop at the first."""

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
            self._items.append(replace(finding, message=shown(finding.message, _LONGEST)))

    def error(self, message: str, where: str, consequence: str) -> None:
        self.add(Finding("error", message, where, consequence))

    def warning(self, message: str, where: str, consequence: str) -> None:
        self.add(Finding("warning", message, where, consequence))

    def note(self, message: str, where: str, consequence: str) -> None:
        self.add(Finding("note", message, where, consequence))

    def forget(self, places: frozenset[str]) -> None:
        """Removes the findings about `places`, which are left out of the capture."""
        kept = [f for f in self._items if f.where not in places]
        for finding in self._items:
            self._counts[finding.severity] -= finding.where in places
        self._items = kept

    @property
    def errors(self) -> tuple[Finding, ...]:
        return tuple(f for f in self._items if f.severity == "error")

    def raise_errors(self, source: Path) -> None:
        """Raises InputError with one sentence that names every error and its places (at most 40 places a kind)."""
        errors = self.errors
        if not errors:
            return
        places: dict[str, list[str]] = {}
        for finding in errors:
            places.setdefault(finding.message, []).append(shown(finding.where))
        kinds = []
        for message, wheres in sorted(places.items(), key=lambda kind: -len(kind[1])):
            listed = ", ".join(wheres[:_LISTED])
            more = f" and {len(wheres) - _LISTED} more" if len(wheres) > _LISTED else ""
            count = f", {len(wheres)} times" if len(wheres) > 1 else ""
            kinds.append(f"{message}{count} ({listed}{more})")
        raise InputError(
            f"{source} cannot be used: {'; '.join(kinds)}; repair these and try again, "
            f"`nvsim check {source}` says what each would cause."
        )


@dataclass(frozen=True)
class Report:
    """Everything found in one capture, errors first. `format` is "" where none was recognised."""

    source: Path
    format: str
    findings: tuple[Finding, ...]

    @property
    def refused(self) -> bool:
        """Whether an import would refuse the capture."""
        return any(f.severity == "error" for f in self.findings)
