"""The panel that shows and copies the agent's state: all fields of the simulator and a table of navigable locations."""

from __future__ import annotations

import math
from collections.abc import Callable

from PySide6.QtCore import QModelIndex, Qt, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QPushButton, QWidget

from nvsim_app.agent.agent_walk import AgentWalk
from nvsim_app.agent.state import AgentState, Location
from nvsim_app.look.boxes import STRETCH, hbox, vbox
from nvsim_app.look.labels import Hint, Label, Value
from nvsim_app.look.table import Column, TableModel, table
from nvsim_app.look.widgets import named


def angle(radians: float, short: bool = False) -> str:
    """Formats an angle in radians and degrees; `short` gives fewer digits."""
    degrees = math.degrees(radians)
    return f"{radians:.3f} ({degrees:.0f}°)" if short else f"{radians:.4f} rad   {degrees:.1f}°"


_FIELDS: dict[str, Callable[[AgentState], str]] = {
    "scanId": lambda s: s.scanId,
    "step": lambda s: str(s.step),
    "viewpointId": lambda s: s.location.viewpointId,
    "x, y, z": lambda s: f"{s.location.x:.3f}, {s.location.y:.3f}, {s.location.z:.3f} m",
    "heading": lambda s: angle(s.heading),
    "elevation": lambda s: angle(s.elevation),
    "viewIndex": lambda s: str(s.viewIndex),
}
Row = tuple[int, Location, str]
"""A navigable location: its index, the location, and the name of its viewpoint. Index 0 means to stay."""
_COLUMNS: tuple[Column[Row], ...] = (
    Column("", lambda row: row[0], tip="The number to press, and the index for makeAction"),
    Column("viewpoint", lambda row: row[2] if row[0] else "stay", tip="Double-click to go to the viewpoint",
           about=lambda row: row[1].viewpointId),
    Column("rel_heading", lambda row: row[1].rel_heading, lambda value: angle(value, short=True),
           "Angle to the right of the agent's heading, radians; degrees in parentheses", number=True),
    Column("rel_elevation", lambda row: row[1].rel_elevation, lambda value: angle(value, short=True),
           "Angle above the agent's viewing direction, radians; degrees in parentheses", number=True, optional=True),
    Column("rel_distance", lambda row: row[1].rel_distance, "{:.3f}".format, "Meters", number=True),
)  # fmt: skip
_NOTHING = "Select a viewpoint, then Graph > Walk as an agent. This panel then shows the agent's state."


class AgentPanel(QWidget):
    """Shows the state of an AgentWalk.

    taken(str)               the user activated the navigable location with this viewpoint id
    pointedAt(int)           the current row, the index of a navigable location; -1 for none
    copyStateWanted(), copyTrajectoryWanted()
    restrictedChosen(bool)   restricted navigation was switched
    imageChosen(bool)        the agent's image was switched on or off
    """

    taken = Signal(str)
    pointedAt = Signal(int)
    copyStateWanted = Signal()
    copyTrajectoryWanted = Signal()
    restrictedChosen = Signal(bool)
    imageChosen = Signal(bool)

    def __init__(self, walk: AgentWalk) -> None:
        super().__init__()
        self._walk = walk
        self.values = {name: Value(parent=self) for name in _FIELDS}
        for name, value in self.values.items():
            value.setAccessibleName(name)
        self.model: TableModel[Row] = TableModel(_COLUMNS, self, dense=True)
        self.table = table(self.model, self, "Navigable locations")
        self.table.setObjectName("navigableLocations")
        self.table.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the focus with the image or the map
        self.table.setMinimumHeight(4 * (self.fontMetrics().height() + 5))
        self.restricted = self._box("Only in view", "Restricted navigation: only locations in the image are navigable")
        self.image = self._box("Image", "Show the agent's image instead of the 3D view")
        self.copy_state = self._button("Copy state", "Copy all fields as JSON (Ctrl+C)")
        self.copy_trajectory = self._button(
            "Copy trajectory",
            "Copy all poses as [[viewpointId, heading, elevation], …], the format of leaderboards",
        )
        self._lay_out()
        self.restricted.setChecked(True)
        self.restricted.toggled.connect(self.restrictedChosen)
        self.image.toggled.connect(self.imageChosen)
        self.copy_state.clicked.connect(self.copyStateWanted)
        self.copy_trajectory.clicked.connect(self.copyTrajectoryWanted)
        self.table.activated.connect(self._choose_location)
        self.table.selectionModel().currentRowChanged.connect(self._on_current)
        self.hint = Hint(self.table, lambda: "" if walk.active else _NOTHING)
        walk.changed.connect(self.refresh)
        self.refresh()

    def _box(self, text: str, words: str) -> QCheckBox:
        made = named(QCheckBox(text, self), tip=words)
        made.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click does not move the keyboard focus
        return made

    def _button(self, text: str, words: str) -> QPushButton:
        made = named(QPushButton(text, self), tip=words)
        made.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        return made

    def _lay_out(self) -> None:
        fields = QGridLayout()
        fields.setColumnStretch(1, 1)
        fields.setHorizontalSpacing(8)
        fields.setVerticalSpacing(4)
        for row, (name, value) in enumerate(self.values.items()):
            caption = Label(name, self, quiet=True)
            fields.addWidget(caption, row, 0)
            fields.addWidget(value, row, 1)
        choices = hbox(self.restricted, self.image, STRETCH)
        buttons = hbox(self.copy_state, self.copy_trajectory, STRETCH)
        vbox(fields, (self.table, 1), choices, buttons, on=self, margins=8, spacing=8)

    def point(self, index: int) -> None:
        """Selects the row of a navigable location; -1 selects none."""
        self.table.setCurrentIndex(self.model.index(index, 0))

    def refresh(self) -> None:
        state = self._walk.state
        for name, value in self.values.items():
            value.show_value("" if state is None else _FIELDS[name](state))
        places = () if state is None else state.navigableLocations
        self.model.show([(i, place, self._walk.name_of(place.viewpointId)) for i, place in enumerate(places)])
        for widget in (self.copy_state, self.copy_trajectory, self.image):
            widget.setEnabled(state is not None)
        self.hint.refresh()

    def _choose_location(self, index: QModelIndex) -> None:
        if index.row() > 0:
            self.taken.emit(self.model.row(index.row())[1].viewpointId)

    def _on_current(self, index: QModelIndex) -> None:
        self.pointedAt.emit(index.row())
