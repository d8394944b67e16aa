"""The panel of threshold sliders: the tried values, their effect on the edges, and buttons to apply them."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QPushButton,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from nvsim.cli.options import field_docs
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.rethreshold import ThresholdEffect
from nvsim.mapping.families import FAMILIES
from nvsim.project.work import STAGE, sentence
from nvsim_app.look import colors
from nvsim_app.look.boxes import STRETCH, hbox
from nvsim_app.look.labels import Label, MarkedLabel
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.widgets import named, push_button
from nvsim_app.state.document import Document
from nvsim_app.thresholds.slider import MARKS, ThresholdRow, preset, thresholds, with_value
from nvsim_app.thresholds.threshold_preview import ThresholdPreview

_ACROSS = 3  # check boxes in a row
_RULES = {"worst": "Mean, worst row and cell", "mean": "Mean only (the paper's)"}


class ThresholdPanel(QScrollArea):
    """Shows the sliders. applied(): change the edges as shown. built(): build the map again with these thresholds."""

    applied = Signal()
    built = Signal()

    def __init__(self, trial: ThresholdPreview, document: Document) -> None:
        super().__init__(widgetResizable=True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self._trial, self._document = trial, document
        content = QWidget(self)
        layout = QVBoxLayout(content)
        layout.setContentsMargins(8, 8, 8, 8)
        layout.setSpacing(4)
        self.outcome, self.notes = MarkedLabel(content), Label(content)
        self.outcome.setWordWrap(True)
        self.notes.setWordWrap(True)
        self.notes.setForegroundRole(self.notes.palette().ColorRole.PlaceholderText)
        docs = field_docs(MappingConfig)
        layout.addWidget(self.outcome)
        layout.addLayout(self._buttons(content))
        layout.addWidget(self.notes)
        layout.addSpacing(4)
        layout.addLayout(self._rules(content, docs))
        layout.addLayout(self._families(content, docs))
        self.rows = {t.field: ThresholdRow(t, docs.get(t.field, ""), content) for t in thresholds()}
        for row in self.rows.values():
            row.chosen.connect(self._choose)
            layout.addWidget(row)
        layout.addLayout(self._presets(content))
        layout.addStretch(1)
        self.setWidget(content)
        trial.changed.connect(self.refresh)
        trial.decided.connect(self._show_outcome)
        self.refresh()

    def _buttons(self, parent: QWidget) -> QHBoxLayout:
        self.apply = QPushButton("Apply", parent)
        self.reset = named(QPushButton("Reset", parent), tip="Restore the thresholds of the project's graph")
        self.build = QPushButton("Build again…", parent)
        self.build.setToolTip("Build the map again with these thresholds. This also explores steps that newly open")
        self.apply.clicked.connect(self.applied)
        self.reset.clicked.connect(lambda: self._trial.set_config(self._trial.project_config))
        self.build.clicked.connect(self.built)
        return hbox(self.apply, self.reset, self.build, STRETCH)

    def _rules(self, parent: QWidget, docs: dict[str, str]) -> QHBoxLayout:
        self.rule = QComboBox(parent)
        for key, text in _RULES.items():
            self.rule.addItem(text, key)
        self.rule.setToolTip(tooltip_text(docs.get("rule", "")))
        self.rule.setAccessibleName("Rule")
        self.both_ways = named(QCheckBox("Both ways", parent), tip=docs.get("both_ways", ""))
        self.rule.currentIndexChanged.connect(lambda _: self._choose("rule", self.rule.currentData()))
        self.both_ways.toggled.connect(lambda on: self._choose("both_ways", on))
        return hbox((self.rule, 1), self.both_ways)

    def _families(self, parent: QWidget, docs: dict[str, str]) -> QGridLayout:
        grid = QGridLayout()
        self.families = {family: QCheckBox(family.capitalize(), parent) for family in FAMILIES}
        for i, (family, box) in enumerate(self.families.items()):
            box.setObjectName(f"criterion_{family}")
            box.setToolTip(tooltip_text(docs.get("criteria", "")))
            box.toggled.connect(lambda _: self._choose_families())
            grid.addWidget(box, *divmod(i, _ACROSS))
        grid.setColumnStretch(_ACROSS, 1)
        return grid

    def _choose_families(self) -> None:
        chosen = tuple(family for family, box in self.families.items() if box.isChecked())
        if chosen:
            self._choose("criteria", chosen)
        else:
            self.refresh()  # at least one criterion must stay selected

    def _presets(self, parent: QWidget) -> QHBoxLayout:
        row = QHBoxLayout()
        row.setSpacing(4)
        for key, text, words in (
            ("project", "Project's", "The thresholds of the project's graph"),
            ("default", "Defaults", "The defaults of NVSim"),
            ("paper", "Paper's", "The criteria of the paper: means over the corridor, in one direction"),
        ):
            mark = MarkedLabel(f'<span style="color:{MARKS[key]}">▲</span>', parent)
            tip = f"{words}; the mark of this color below each slider"
            button = push_button(
                text, parent, lambda _=False, k=key: self.apply_preset(k), tip, flat=True, objectName=f"preset_{key}"
            )
            row.addWidget(mark)
            row.addWidget(button)
        row.addStretch(1)
        return row

    def apply_preset(self, name: str) -> None:
        """Moves all sliders to the values of "project", "default", or "paper"."""
        self._trial.set_config(preset(self._trial.project_config, self._sources()[name]))

    def _sources(self) -> dict[str, MappingConfig]:
        return {"project": self._trial.project_config, "default": MappingConfig(), "paper": MappingConfig.paper()}

    def _choose(self, field: str, value: bool | float | str | tuple[str, ...]) -> None:
        self._trial.set_config(with_value(self._trial.config, field, value))

    def changeEvent(self, event: QEvent) -> None:
        """Rewrites the headline in the colors of the new theme."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "outcome"):
            self.outcome.setText(self._headline())

    # Showing ---------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        config, sources = self._trial.config, self._sources()
        with QSignalBlocker(self.rule), QSignalBlocker(self.both_ways):
            self.rule.setCurrentIndex(list(_RULES).index(config.rule))
            self.both_ways.setChecked(config.both_ways)
        for family, box in self.families.items():
            with QSignalBlocker(box):
                box.setChecked(family in config.criteria)
        for threshold in thresholds():
            marks = {name: threshold.value_in(source) for name, source in sources.items()}
            self.rows[threshold.field].setVisible(not threshold.family or threshold.family in config.criteria)
            decides = config.rule == "worst" or not threshold.worst_only
            self.rows[threshold.field].show_value(threshold.value_in(config), marks, decides)
        shown = [row.name for row in self.rows.values() if not row.isHidden()]
        width = max(name.fontMetrics().horizontalAdvance(name.text()) for name in shown) + 8
        for name in shown:
            name.setFixedWidth(width)
        self._show_outcome()

    def _show_outcome(self) -> None:
        reason = self.obstacle
        self.apply.setEnabled(reason is None)
        self.apply.setToolTip(
            "Change the edges of the graph as shown, as one step that can be undone"
            if reason is None
            else tooltip_text(f"Unavailable: {reason}.")
        )
        self.reset.setEnabled(self._trial.differs)
        self.build.setEnabled(self._document.project is not None and self._document.graph is not None)
        self.outcome.setText(self._headline())
        self.notes.setText(self._notes())

    @property
    def obstacle(self) -> str | None:
        """The reason why nothing can be applied; None if it can."""
        if self._document.graph is None:
            return STAGE["map"].missing
        if self._trial.preparing:
            return "the evidence is still being prepared"
        if self._trial.refusal:
            return "a criterion needs values that were not measured"
        if not self._trial.outcome:
            return "these thresholds change no edge"
        editing = self._document.editing
        return None if editing.writable else editing.locked.rstrip(".") or "the graph cannot be edited here"

    def _headline(self) -> str:
        outcome = self._trial.outcome
        if self._document.graph is None:
            return sentence(STAGE["map"].missing)
        if self._trial.preparing:
            return "Preparing the evidence…"
        if self._trial.refusal:
            return "Some values were not measured; Build again… measures them."
        if outcome is None:
            return "Move a slider to see its effect."
        if not outcome:
            return "No edge appears or disappears."
        more, less = len(outcome.new_edges), len(outcome.lost_edges)
        appear, disappear = colors.text("open"), colors.text("blocked")
        return (
            f'<span style="color:{appear}"><b>+{more:,}</b></span> {_edges(more)} would appear, '
            f'<span style="color:{disappear}"><b>−{less:,}</b></span> would disappear'
        )

    def _notes(self) -> str:
        outcome = self._trial.outcome
        return plain(self._trial.refusal) if outcome is None else " ".join(side_effect_notes(outcome))


def side_effect_notes(outcome: ThresholdEffect) -> list[str]:
    """The side effects of an outcome, one sentence each."""
    found = []
    if outcome.isolated_viewpoints:
        verb = _singular_or_plural(outcome.isolated_viewpoints, "viewpoint loses its", "viewpoints lose their")
        found.append(f"{outcome.isolated_viewpoints:,} {verb} last edge.")
    if outcome.kept_by_user:
        verb = _singular_or_plural(outcome.kept_by_user, "edge stays", "edges stay")
        found.append(f"{outcome.kept_by_user:,} {verb}: added or locked by a user.")
    if outcome.one_way_measured:
        found.append(f"For {outcome.one_way_measured:,} new edges, the opposite direction was not measured.")
    if outcome.new_steps:
        verb = _singular_or_plural(outcome.new_steps, "step leads", "steps lead")
        found.append(f"{outcome.new_steps:,} {verb} to places without a viewpoint; only Build again explores them.")
    return found


def _edges(count: int) -> str:
    return _singular_or_plural(count, "edge", "edges")


def _singular_or_plural(count: int, one: str, many: str) -> str:
    return one if count == 1 else many
