"""Threshold sliders with a preview in both views, and the calibration of the thresholds beside them."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QFileDialog

from nvsim.errors import InputError
from nvsim.files.user_folders import home_folder
from nvsim.graph.difference import Difference
from nvsim.mapping.config import MappingConfig
from nvsim_app.actions import Action
from nvsim_app.state.reasons import with_evidence, with_graph
from nvsim_app.thresholds.calibration_panel import CalibrationPanel
from nvsim_app.thresholds.calibrations import Calibrations
from nvsim_app.thresholds.panel import ThresholdPanel
from nvsim_app.thresholds.slider import thresholds
from nvsim_app.thresholds.threshold_preview import PreviewLayer, ThresholdPreview
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.part import Dock, Part, WindowContext


class ThresholdPart(Part):
    """Tries thresholds on the graph, and applies them."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        document = context.document
        self.trial = ThresholdPreview(document, self)
        self.panel = ThresholdPanel(self.trial, document)
        self.layer = PreviewLayer(self.trial, document)
        context.modes.beneath.append(self.layer.paint_on_map)
        self.panel.applied.connect(self.apply)
        self.panel.built.connect(self.build)
        self.trial.decided.connect(self._on_trial)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._on_edit)
        document.projectLeft.connect(self._forget_applied)
        document.editing.stepsChanged.connect(self._on_steps)
        self._kept: dict[str, Any] | None = None  # the applied thresholds of the project, by the time of their step

    def docks(self) -> tuple[Dock, ...]:
        return (
            Dock("thresholds", "Thresholds", self.panel, "right", tab="details", needs=with_evidence,
                 workspaces=("edit",)),
        )  # fmt: skip

    def restore(self, settings: QSettings) -> None:
        self.context.scene.overlays.add(self.layer)
        self._inspector = self.context.part(InspectorPart)

    def store(self, settings: QSettings) -> None:
        self.trial.stop()

    def show_panel(self) -> None:
        """Brings the panel to the front."""
        self.context.window.show_dock("thresholds")

    def _apply_preset(self, preset: str) -> None:
        self.show_panel()
        self.panel.apply_preset(preset)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & {"graph", "capture"}:
            self.trial.on_graph(fresh="graph" in parts)
            applied = self._applied_thresholds()
            if "graph" in parts and applied is not None:
                self.trial.set_config(applied)

    def _on_edit(self, change: Difference) -> None:
        self.trial.on_graph(fresh=False)

    def _on_trial(self) -> None:
        self.context.modes.refresh()
        tried = self.trial.differs and not self.trial.refusal
        self._inspector.inspection.try_out(self.trial.config if tried else None)

    # Applying ----------------------------------------------------------------------------------------------------

    def apply(self) -> None:
        """Applies the previewed edges, as one step."""
        graph, outcome = self.trial.graph(), self.trial.outcome
        if self.panel.obstacle is not None or graph is None or outcome is None:
            return
        text = f"Decide again: {len(outcome.new_edges)} edges appear, {len(outcome.lost_edges)} disappear"
        if self.context.document.editing.perform(text, graph):
            self._remember_applied()

    def build(self) -> None:
        """Starts a job that builds the map with these thresholds."""
        from nvsim_app.forms.fields import Settings, fields_of

        document, notices = self.context.document, self.context.notices
        project = document.project
        if project is None:
            return
        settings = Settings(project)
        preset = settings.preset("map")
        values = settings.changed("map")
        tried = {t.field for t in thresholds()} | {"rule", "both_ways", "criteria"}
        tried |= {"views", "panorama_width"}  # kept from the project, so that its evidence can be reused
        for field in fields_of("map", preset):
            name = field.path.rpartition(".")[2]
            if name in tried:
                values[field.path] = getattr(self.trial.config, name)
        with notices.reporting():
            settings.keep("map", preset, values)
            arguments = [word for word in settings.arguments("map") if word != "--reapply"]
            self.context.jobs.start("map", [*arguments, "--reapply"], project, "Decide the map again")
            notices.info("The map is built again with these thresholds; the Jobs panel shows the progress.")

    def _remember_applied(self) -> None:
        """Stores the applied thresholds with their step, so that the edited graph has them when it is opened again."""
        history = self.context.document.editing.history
        if history is None:
            return
        kept = self._kept or {"built": asdict(self.trial.project_config), "base": None, "steps": {}}
        kept.pop("applied", None)  # so that the new step is written
        kept["steps"][repr(history.steps[history.index].when)] = asdict(self.trial.config)
        self._kept = kept
        self._on_steps()

    def _on_steps(self) -> None:
        """Stores the thresholds of the current step, which an undo or a redo may change."""
        history, kept = self.context.document.editing.history, self._kept
        if history is None or kept is None:
            return
        known = [kept["steps"].get(repr(step.when)) for step in history.steps[: history.index + 1]]
        applied = next((config for config in reversed(known) if config is not None), kept["base"])
        if applied != kept.get("applied", self):
            kept["applied"] = applied
            self.context.settings.setValue(self._key(), json.dumps(kept))

    def _forget_applied(self) -> None:
        self._kept = None

    def _applied_thresholds(self) -> MappingConfig | None:
        """The thresholds that were applied to the graph on screen; None if none were."""
        history, self._kept = self.context.document.editing.history, None
        try:
            kept = json.loads(str(self.context.settings.value(self._key(), "")))
            steps = dict(kept.get("steps", {}))
            if MappingConfig(**kept["built"]) != self.trial.project_config or history is None:
                return None
            if not steps.keys() & {repr(step.when) for step in history.steps}:
                # The history begins at the saved graph, and does not contain the step.
                steps, kept["base"] = {}, kept["applied"]
            self._kept = {"built": kept["built"], "base": kept["base"], "steps": steps}
            self._on_steps()
            applied = self._kept["applied"]
            return None if applied is None else MappingConfig(**applied)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, InputError):
            return None  # nothing was applied, or the stored value is not valid

    def _key(self) -> str:
        name = str(self.context.document.path).replace("/", "|").replace("\\", "|")
        return f"thresholds/{name}"

    ACTIONS = (
        Action("&Graph", 9, "thresholds", "&Thresholds",
               "Try other thresholds on the whole graph, and preview the changed edges", show_panel, "Shift+I",
               with_graph, icon="thresholds"),
        Action("&Graph", 9, "thresholds_paper", "Try the &paper's thresholds",
               "Preview the graph with the criteria of the paper", lambda self: self._apply_preset("paper"),
               enabled=with_graph),
        Action("&Graph", 9, "thresholds_reset", "Thresholds as &built",
               "Return to the thresholds that the graph was built with", lambda self: self._apply_preset("project"),
               enabled=with_graph),
    )  # fmt: skip


class CalibratePart(Part):
    """Shows the calibration of the thresholds."""

    def docks(self) -> tuple[Dock, ...]:
        document, trial = self.context.document, self.context.part(ThresholdPart).trial
        self.calibrations = Calibrations(document, trial, self)
        self.panel = CalibrationPanel(self.calibrations, trial, document)
        self.panel.mapWanted.connect(self.choose_map)
        document.projectChanged.connect(self.calibrations.clear)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._on_edit)
        return (
            Dock("calibration", "Calibration", self.panel, "bottom", tab="jobs", needs=with_evidence,
                 workspaces=("edit",)),
        )  # fmt: skip

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
        start = str(self.calibrations.truth or self.context.document.path or home_folder())
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

    ACTIONS = (
        Action("&Graph", 9, "calibration", "Calibrat&ion",
               "Compare every value of a threshold with an occupancy map, and suggest a value", show_panel,
               enabled=with_evidence),
    )  # fmt: skip
