"""The data check of a capture in a process of its own, as it decodes every image."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject

from app.jobs.question import Question
from nvsim.capture.findings import SEVERITIES, Severity

SCALE_UNKNOWN = "the scale is unknown"


@dataclass(frozen=True)
class Group:
    """What is the matter, how bad, what it would cause, and all the places where it is so."""

    severity: Severity
    message: str
    consequence: str
    places: tuple[str, ...]


@dataclass(frozen=True)
class CheckResult:
    """Whether an import would refuse the capture, what was found, worst first, and whether metres must be given."""

    refused: bool
    groups: tuple[Group, ...]

    @property
    def wants_scale(self) -> bool:
        return any(g.message == SCALE_UNKNOWN for g in self.groups)

    @property
    def sentence(self) -> str:
        """The result in plain words."""
        if self.refused:
            return "This capture cannot be used as it is."
        if self.wants_scale:
            return "The capture can be used once its scale is known: say how high the cameras were above the floor."
        warnings = sum(g.severity == "warning" for g in self.groups)
        if warnings:
            return f"The capture can be used; {warnings} thing{'s' if warnings > 1 else ''} may cost quality."
        return "The capture is fine."


def result_of(text: str) -> CheckResult:
    """What `nvsim check --json` printed. Raises ValueError when it is something else."""
    try:
        data = json.loads(text)
        groups: dict[tuple[Severity, str], list[dict[str, str]]] = {}
        for finding in data["findings"]:
            if finding["severity"] not in SEVERITIES:
                raise ValueError(f"not a finding of a data check: {str(finding)[:80]}")
            groups.setdefault((finding["severity"], finding["message"]), []).append(finding)
        found = tuple(
            Group(severity, message, items[0]["consequence"], tuple(i["where"] for i in items))
            for (severity, message), items in groups.items()
        )
        return CheckResult(bool(data["refused"]), found)
    except (KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"not a data check: {text[:80]!r}") from error


class CaptureCheck(Question):
    """finished(CheckResult), or failed(str) with a sentence; of the last `start` only."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(result_of, "The data check", parent)

    def start(self, capture: Path, scale: float | None = None, camera_height: float | None = None) -> None:
        """Checks in the background, in place of what is being checked."""
        words = ["check", str(capture), "--json"]
        words += [] if scale is None else ["--scale", str(scale)]
        words += [] if camera_height is None else ["--camera-height", str(camera_height)]
        self.ask(words)
