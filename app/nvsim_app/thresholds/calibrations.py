"""The calibration of the displayed graph, which a side process computes, and the texts about it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Signal

from nvsim.evaluation.calibrated import Calibration, Judge
from nvsim.evaluation.interval import cases_needed
from nvsim.mapping.config import MappingConfig
from nvsim.project.work import STAGE, sentence
from nvsim_app.look.plain_text import plain
from nvsim_app.processes.serving import EndMessage
from nvsim_app.processes.side_process import SideProcess
from nvsim_app.state.document import Document
from nvsim_app.state.side_work import CALIBRATION, CalibrationRequest, CalibrationResult
from nvsim_app.thresholds.slider import thresholds, with_value
from nvsim_app.thresholds.threshold_preview import ThresholdPreview

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
        self._last: tuple[CalibrationRequest, CalibrationResult] | None = None
        self._asked: CalibrationRequest | None = None
        self._process = SideProcess(CALIBRATION, self)
        self._process.ended.connect(self._on_ended)

    @property
    def busy(self) -> bool:
        return self._process.running

    @property
    def last_result(self) -> Calibration | None:
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
        self._asked = CalibrationRequest(project, graph, self._trial.config, self.truth, self.in_capture, self.want)
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

    def _on_ended(self, end: EndMessage) -> None:
        self.trouble = end.sentence
        if isinstance(end.value, CalibrationResult) and self._asked is not None:
            self._last = self._asked, end.value
        self.changed.emit()

    # Results -----------------------------------------------------------------------------------------------------

    def suggestion(self, field: str, judge: Judge) -> Row:
        """The suggestion of the last result for a threshold."""
        assert self.last_result is not None
        return next(row for row in self.last_result.suggested if (row["criterion"], row["judge"]) == (field, judge))

    def figures_now(self, field: str) -> Row:
        """The figures at the slider's value of a threshold."""
        return self.figures_at(field, self.value(field))

    def figures_at(self, field: str, value: float) -> Row:
        """The figures at a value of a threshold, or at the nearest calculated value."""
        assert self.last_result is not None
        return min(self.last_result.sweeps[field], key=lambda row: abs(row["threshold"] - value))

    def value(self, field: str) -> float:
        """The slider's value of a threshold."""
        return float(getattr(self._trial.config, field))

    def changed_thresholds(self, field: str) -> tuple[str, ...]:
        """Thresholds other than `field` whose value differs from the last result's."""
        if self._last is None:
            return ()
        then, now = vars(self._last[0].config), vars(self._trial.config)
        return tuple(name for name in then if name != field and then[name] != now[name])

    def taking(self, field: str, judge: Judge) -> MappingConfig | None:
        """The current thresholds with the suggestion for `field`; None if there is no suggestion."""
        value = self.suggestion(field, judge)["threshold"]
        return None if value is None else with_value(self._trial.config, field, float(value))


_NAMES = {t.field: t.name for t in thresholds()}


def cells(state: Calibrations, field: str, judge: Judge) -> list[str]:
    """The cells of a row: threshold, current value, suggested value, and the effect of the suggestion."""
    now, then = state.figures_now(field), state.suggestion(field, judge)
    free = f"{now['validity' + _suffix(judge)]:.3f}"
    found = [_NAMES.get(field, field), f"{state.value(field):.2f}"]
    if then["threshold"] is None:
        return [*found, "none", free, "", ""]
    row = state.figures_at(field, then["threshold"])
    return [
        *(*found, f"{then['threshold']:.2f}", f"{free} → {then['validity']:.3f}"),
        *(f"{row['coverage'] - now['coverage']:+.3f}", f"{row['edges'] - now['edges']:+d}"),
    ]


def sentences(state: Calibrations, field: str, judge: Judge) -> str:
    """The figures of a threshold at its current value, and with the suggestion."""
    found, suffix = state.last_result, _suffix(judge)
    assert found is not None
    now, then = state.figures_now(field), state.suggestion(field, judge)
    words = f"Now {state.value(field):.2f}: {_figures(now, suffix)}. "
    if then["threshold"] is None:
        return words + (
            f"No value is good enough for {found.want:g}: the interval of {then['best_threshold']:.2f} begins at "
            f"{then['best_low']:.3f}. A suggestion needs at least {cases_needed(found.want)} accepted corridors, "
            f"all of them free; {now['accepted']} are accepted now."
        )
    row = state.figures_at(field, then["threshold"])
    words += f"{then['threshold']:.2f} would give {_figures(row, suffix)}"
    steps = "step opens" if row["beyond"] == 1 else "steps open"
    return words + (f"; {row['beyond']} {steps} toward new places, use Build again." if row["beyond"] else ".")


def status(state: Calibrations, document: Document, chosen: str) -> str:
    """The status of the calibration, or the missing input."""
    found = state.last_result
    if state.busy:
        return "Evaluating the graph with every value of every threshold…"
    if state.trouble:
        return plain(state.trouble, 600)
    if document.graph is None:
        return sentence(STAGE["map"].missing)
    if document.project is None:
        return "A graph file has no evidence to decide again; open a project."
    if found is None or state.map is None:
        return "Calculate compares every value of a threshold with an occupancy map as the ground truth."
    if not state.is_of_this_graph:
        return "The graph has changed since; select Calculate to evaluate it again."
    if found.want != state.want:
        return f"This is for surely {found.want:g}; select Calculate to find the loosest values for {state.want:g}."
    if chosen and state.changed_thresholds(chosen):
        return "Other sliders have moved since; select Calculate to update the figures."
    now, judge = found.now, "/".join(state.map.parts[-2:])
    return f"{now['accepted']:,} of {now['corridors']:,} corridors are accepted, judged by {plain(judge, 60)}."


def _suffix(judge: Judge) -> str:
    return "" if judge == "point" else f"_{judge}"


def _figures(row: dict[str, Any], suffix: str) -> str:
    return (
        f"{row['validity' + suffix]:.3f} free ({row['low' + suffix]:.3f} to {row['high' + suffix]:.3f}), "
        f"{row['coverage']:.3f} covered, {row['edges']:,} edges"
    )
