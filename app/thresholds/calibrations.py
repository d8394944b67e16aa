"""The calibration of the displayed graph, which a side process computes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from app.processes.serving import Ended
from app.processes.side_process import SideProcess
from app.state.calibration_child import CALIBRATION, Asked, Calibrated
from app.state.document import Document
from app.thresholds.table import changed
from app.thresholds.threshold_preview import ThresholdPreview
from nvsim.evaluation.calibrated import Calibration, Judge
from nvsim.mapping.config import MappingConfig

Row = dict[str, Any]
"""Figures as `nvsim.evaluation.calibrated.Calibration` describes them."""


class Calibrations(QObject):
    """Computes and stores the calibration. changed(): a calibration started, finished, or became out of date."""

    changed = Signal()

    def __init__(self, document: Document, trial: ThresholdPreview, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document, self._trial = document, trial
        self.truth: Path | None = None
        """The map that the user selected; None for the map of the project."""
        self.in_capture = False
        """Whether that map is in the coordinate frame of the capture."""
        self.want = 0.99
        self.trouble = ""
        self._last: tuple[Asked, Calibrated] | None = None
        self._asked: Asked | None = None
        self._process = SideProcess(CALIBRATION, self)
        self._process.ended.connect(self._on_ended)

    @property
    def busy(self) -> bool:
        return self._process.running

    @property
    def found(self) -> Calibration | None:
        """The last result, even if it is out of date; None before the first."""
        return None if self._last is None else self._last[1].found

    @property
    def map(self) -> Path | None:
        """The map of the last result."""
        return None if self._last is None else self._last[1].map

    @property
    def is_of_this_graph(self) -> bool:
        return self._last is not None and self._last[0].graph is self._document.graph

    def start(self) -> None:
        """Starts a calibration of the displayed graph and thresholds. Cancels the running one."""
        project, graph = self._document.project, self._document.graph
        if project is None or graph is None:
            return
        self.trouble = ""
        self._asked = Asked(project, graph, self._trial.config, self.truth, self.in_capture, self.want)
        self._process.open(self._asked)
        self.changed.emit()

    def stop(self) -> None:
        """Stops the calculation, and returns when it has ended."""
        self._process.close()

    def clear(self) -> None:
        """Drops all results, because another project is shown."""
        self.stop()
        self.truth, self.in_capture, self.trouble, self._last = None, False, "", None
        self.changed.emit()

    def _on_ended(self, end: Ended) -> None:
        self.trouble = end.sentence
        if isinstance(end.value, Calibrated) and self._asked is not None:
            self._last = self._asked, end.value
        self.changed.emit()

    # Results -----------------------------------------------------------------------------------------------------

    def suggestion(self, field: str, judge: Judge) -> Row:
        """The suggestion of the last result for a threshold."""
        assert self.found is not None
        return next(row for row in self.found.suggested if (row["criterion"], row["judge"]) == (field, judge))

    def now(self, field: str) -> Row:
        """The figures at the slider's value of a threshold."""
        return self.at(field, self.value(field))

    def at(self, field: str, value: float) -> Row:
        """The figures at a value of a threshold, or at the nearest calculated value."""
        assert self.found is not None
        return min(self.found.sweeps[field], key=lambda row: abs(row["threshold"] - value))

    def value(self, field: str) -> float:
        """The slider's value of a threshold."""
        return float(getattr(self._trial.config, field))

    def moved(self, field: str) -> tuple[str, ...]:
        """Thresholds other than `field` whose value differs from the last result's."""
        if self._last is None:
            return ()
        then, now = vars(self._last[0].config), vars(self._trial.config)
        return tuple(name for name in then if name != field and then[name] != now[name])

    def taking(self, field: str, judge: Judge) -> MappingConfig | None:
        """The current thresholds with the suggestion for `field`; None if there is no suggestion."""
        value = self.suggestion(field, judge)["threshold"]
        return None if value is None else changed(self._trial.config, field, float(value))
