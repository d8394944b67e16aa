"""The calibration part: its panel beside the threshold sliders, and the selection of an occupancy map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QFileDialog

from app.actions import Action
from app.state.reasons import with_measured
from app.thresholds.calibration_panel import CalibrationPanel
from app.thresholds.calibrations import Calibrations
from app.wiring.part import Dock, Part
from app.wiring.thresholds import ThresholdPart
from nvsim.files.user_folders import home
from nvsim.graph.difference import Difference


class CalibratePart(Part):
    """Shows the calibration of the thresholds."""

    ACTIONS = (
        Action("calibration", "Calibrat&ion",
               "Compare every value of a threshold with an occupancy map, and suggest a value", "&Graph", 9,
               enabled=with_measured),
    )  # fmt: skip

    def docks(self) -> tuple[Dock, ...]:
        document, trial = self.context.document, self.context.part(ThresholdPart).trial
        self.calibrations = Calibrations(document, trial, self)
        self.panel = CalibrationPanel(self.calibrations, trial, document)
        self.panel.mapWanted.connect(self.choose_map)
        document.projectChanged.connect(self.calibrations.clear)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._on_edit)
        return (
            Dock("calibration", "Calibration", self.panel, "bottom", tab="jobs", needs=with_measured,
                 workspaces=("edit",)),
        )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        return {"calibration": self.show_panel}

    def store(self, settings: QSettings) -> None:
        self.calibrations.stop()

    def show_panel(self) -> None:
        """Shows the panel and the sliders. Starts the calculation if this graph has no result."""
        for dock in ("thresholds", "calibration"):
            self.context.window.show_dock(dock)
        if not self.calibrations.busy and not self.calibrations.is_of_this_graph:
            self.calibrations.start()

    def choose_map(self) -> None:
        window = self.context.window
        start = str(self.calibrations.truth or self.context.document.path or home())
        name, _ = QFileDialog.getOpenFileName(
            window, "Select an occupancy map", start, "Occupancy maps (*.yaml *.yml *.bt *.ot)"
        )
        if name:
            self.panel.choose_map(Path(name))

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "graph" in parts:
            self.panel.refresh()

    def _on_edit(self, change: Difference) -> None:
        self.panel.refresh()
