"""What each threshold buys and costs on the graph that is shown: worked out in a process, waited for in a thread."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from app.state.calibration_child import Asked, Calibrated, CalibrationChild
from app.state.document import Document
from app.state.waiting import Waiting
from app.thresholds.table import changed
from app.thresholds.trial import Trial
from nvsim.evaluation.calibrated import Calibration, Judge
from nvsim.mapping.config import MappingConfig

Row = dict[str, Any]
"""Figures as `nvsim.evaluation.calibrated.Calibration` describes them."""


class Calibrations(QObject):
    """changed(): something is worked out, was worked out, or holds no more."""

    changed = Signal()

    def __init__(self, document: Document, trial: Trial, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document, self._trial = document, trial
        self.truth: Path | None = None
        """The map that a user chose; None for the project's own."""
        self.in_capture = False
        """Whether that map is in the capture's frame."""
        self.want = 0.99
        self.trouble = ""
        self._last: tuple[Asked, Calibrated] | None = None
        self._asked: Asked | None = None
        self._waiting = Waiting("calibration", self)
        self._waiting.ended.connect(self._on_ended)

    @property
    def busy(self) -> bool:
        return self._waiting.busy

    @property
    def found(self) -> Calibration | None:
        """The last one, also where it holds no more; None before the first."""
        return None if self._last is None else self._last[1].found

    @property
    def map(self) -> Path | None:
        """The map that judged in the last one."""
        return None if self._last is None else self._last[1].map

    @property
    def is_of_this_graph(self) -> bool:
        return self._last is not None and self._last[0].graph is self._document.graph

    def start(self) -> None:
        """Works it out for the graph and the thresholds that are shown, in place of what is under way."""
        project, graph = self._document.project, self._document.graph
        if project is None or graph is None:
            return
        self.trouble = ""
        self._asked = Asked(project, graph, self._trial.config, self.truth, self.in_capture, self.want)
        self._waiting.start(CalibrationChild(self._asked))
        self.changed.emit()

    def stop(self) -> None:
        """Nothing runs when this returns."""
        self._waiting.stop()

    def clear(self) -> None:
        """Another project is shown: its map is another one too."""
        self.stop()
        self.truth, self.in_capture, self.trouble, self._last = None, False, "", None
        self.changed.emit()

    def _on_ended(self, found: Calibrated | None, trouble: str) -> None:
        self.trouble = trouble
        if found is not None and self._asked is not None:
            self._last = self._asked, found
        self.changed.emit()

    # What it says ------------------------------------------------------------------------------------------------

    def suggestion(self, field: str, judge: Judge) -> Row:
        """Of the last one, for a threshold that was swept."""
        assert self.found is not None
        return next(row for row in self.found.suggested if (row["criterion"], row["judge"]) == (field, judge))

    def now(self, field: str) -> Row:
        """The figures at the value that the slider of a threshold has."""
        return self.at(field, self.value(field))

    def at(self, field: str, value: float) -> Row:
        """The figures at the value of a threshold, or at the nearest that was looked at."""
        assert self.found is not None
        return min(self.found.sweeps[field], key=lambda row: abs(row["threshold"] - value))

    def value(self, field: str) -> float:
        """That of the slider."""
        return float(getattr(self._trial.config, field))

    def moved(self, field: str) -> tuple[str, ...]:
        """Thresholds besides `field` that have another value than it was worked out with."""
        if self._last is None:
            return ()
        then, now = vars(self._last[0].config), vars(self._trial.config)
        return tuple(name for name in then if name != field and then[name] != now[name])

    def taking(self, field: str, judge: Judge) -> MappingConfig | None:
        """The thresholds that are tried, with the suggestion for one; None where there is none."""
        value = self.suggestion(field, judge)["threshold"]
        return None if value is None else changed(self._trial.config, field, float(value))
