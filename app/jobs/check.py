"""The data check of a capture in a process of its own, as it decodes every image."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, Signal

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


class CaptureCheck(QObject):
    """finished(CheckResult), or failed(str) with a sentence; of the last `start` only."""

    finished = Signal(object)
    failed = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._process: QProcess | None = None

    @property
    def running(self) -> bool:
        return self._process is not None

    def start(self, capture: Path, scale: float | None = None, camera_height: float | None = None) -> None:
        """Checks in the background, in place of what is being checked."""
        self.stop()
        words = ["-P", "-m", "nvsim.cli.main", "check", str(capture), "--json"]
        words += [] if scale is None else ["--scale", str(scale)]
        words += [] if camera_height is None else ["--camera-height", str(camera_height)]
        process = self._process = QProcess(self)
        process.finished.connect(self._on_finished)
        process.errorOccurred.connect(self._on_error)
        process.start(sys.executable, words)

    def stop(self) -> None:
        """Ends the check; nothing is told about it."""
        process, self._process = self._process, None
        if process is not None:
            process.finished.disconnect(self._on_finished)
            process.errorOccurred.disconnect(self._on_error)
            process.kill()
            process.waitForFinished(2000)
            process.deleteLater()

    def _on_finished(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        lines = bytes(process.readAllStandardOutput().data()).decode(errors="replace").splitlines()
        said = bytes(process.readAllStandardError().data()).decode(errors="replace").strip()
        process.deleteLater()
        for line in reversed(lines):
            try:
                self.finished.emit(result_of(line))
                return
            except ValueError:
                continue
        self.failed.emit(said.splitlines()[-1] if said else "The data check ended without an answer; try it again.")

    def _on_error(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart and self._process is not None:
            self._process.deleteLater()
            self._process = None
            self.failed.emit(f"The data check could not be started with {sys.executable}; is NVSim installed whole?")
