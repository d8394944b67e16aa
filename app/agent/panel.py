"""The panel that shows and copies the agent's state: all fields of the simulator and a table of navigable locations."""

from __future__ import annotations

import math
from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QAbstractItemView,
    QCheckBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QHeaderView,
    QPushButton,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from app.agent.state import AgentState, Location
from app.agent.walking import AgentWalk
from app.look.labels import Hint, Label, Value
from app.look.plain_text import tip

_FIELDS: dict[str, Callable[[AgentState], str]] = {
    "scanId": lambda s: s.scanId,
    "step": lambda s: str(s.step),
    "viewpointId": lambda s: s.location.viewpointId,
    "x, y, z": lambda s: f"{s.location.x:.3f}, {s.location.y:.3f}, {s.location.z:.3f} m",
    "heading": lambda s: angle(s.heading),
    "elevation": lambda s: angle(s.elevation),
    "viewIndex": lambda s: str(s.viewIndex),
}
_COLUMNS = ("", "viewpoint", "rel_heading", "rel_elevation", "rel_distance")
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

    def __init__(self, walk: AgentWalk, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._walk = walk
        self.values = {name: Value(parent=self) for name in _FIELDS}
        for name, value in self.values.items():
            value.setAccessibleName(name)
        self.table = _Locations(self)
        self.table.setObjectName("navigableLocations")
        self.table.setAccessibleName("Navigable locations")
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
        self.table.itemActivated.connect(self._take)
        self.table.currentItemChanged.connect(self._on_current)
        self.hint = Hint(self.table, lambda: "" if walk.active else _NOTHING)
        walk.changed.connect(self.refresh)
        self.refresh()

    def _box(self, text: str, words: str) -> QCheckBox:
        made = QCheckBox(text, self)
        made.setToolTip(tip(words))
        made.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click does not move the keyboard focus
        return made

    def _button(self, text: str, words: str) -> QPushButton:
        made = QPushButton(text, self)
        made.setToolTip(tip(words))
        made.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        return made

    def _lay_out(self) -> None:
        fields = QGridLayout()
        fields.setColumnStretch(1, 1)
        fields.setHorizontalSpacing(8)
        fields.setVerticalSpacing(4)
        for row, (name, value) in enumerate(self.values.items()):
            caption = Label(name, self)
            caption.setForegroundRole(caption.palette().ColorRole.PlaceholderText)
            fields.addWidget(caption, row, 0)
            fields.addWidget(value, row, 1)
        choices = QHBoxLayout()
        choices.addWidget(self.restricted)
        choices.addWidget(self.image)
        choices.addStretch(1)
        buttons = QHBoxLayout()
        buttons.addWidget(self.copy_state)
        buttons.addWidget(self.copy_trajectory)
        buttons.addStretch(1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(8, 8, 8, 8)
        layout.setSpacing(8)
        layout.addLayout(fields)
        layout.addWidget(self.table, 1)
        layout.addLayout(choices)
        layout.addLayout(buttons)

    def point(self, index: int) -> None:
        """Selects the row of a navigable location; -1 selects none."""
        self.table.blockSignals(True)
        self.table.setCurrentItem(self.table.topLevelItem(index) if index >= 0 else None)  # type: ignore[arg-type]
        self.table.blockSignals(False)

    def refresh(self) -> None:
        state = self._walk.state
        for name, value in self.values.items():
            value.show_value("" if state is None else _FIELDS[name](state))
        self.table.blockSignals(True)
        self.table.clear()
        for index, place in enumerate(() if state is None else state.navigableLocations):
            self.table.addTopLevelItem(_row(index, place, self._walk.name_of(place.viewpointId)))
        self.table.blockSignals(False)
        for widget in (self.copy_state, self.copy_trajectory, self.image):
            widget.setEnabled(state is not None)
        self.hint.refresh()

    def _take(self, item: QTreeWidgetItem) -> None:
        if self.table.indexOfTopLevelItem(item) > 0:
            self.taken.emit(item.data(1, Qt.ItemDataRole.UserRole))

    def _on_current(self, item: QTreeWidgetItem | None) -> None:
        self.pointedAt.emit(-1 if item is None else self.table.indexOfTopLevelItem(item))


class _Locations(QTreeWidget):
    """The table of navigable locations. Location 0 means to stay."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setColumnCount(len(_COLUMNS))
        self.setHeaderLabels(list(_COLUMNS))
        self.setRootIsDecorated(False)
        self.setUniformRowHeights(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setAlternatingRowColors(True)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the keyboard focus with the image or the map
        self.setMinimumHeight(4 * (self.fontMetrics().height() + 5))
        head = self.headerItem()
        for column, words in enumerate(
            (
                "The number to press, and the index for makeAction",
                "Double-click to go to the viewpoint",
                "Angle to the right of the agent's heading, radians; degrees in parentheses",
                "Angle above the agent's viewing direction, radians; degrees in parentheses",
                "Meters",
            )
        ):
            head.setToolTip(column, tip(words))
            if column > 1:
                head.setTextAlignment(column, Qt.AlignmentFlag.AlignRight)
        header = self.header()
        header.setStretchLastSection(False)
        for column in range(len(_COLUMNS)):
            header.setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(1, QHeaderView.ResizeMode.Stretch)


def _row(index: int, place: Location, name: str) -> QTreeWidgetItem:
    item = QTreeWidgetItem(
        [
            str(index),
            name if index else "stay",
            angle(place.rel_heading, short=True),
            angle(place.rel_elevation, short=True),
            f"{place.rel_distance:.3f}",
        ]
    )
    item.setData(1, Qt.ItemDataRole.UserRole, place.viewpointId)
    item.setToolTip(1, tip(place.viewpointId))
    for column in range(2, 5):
        item.setTextAlignment(column, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    return item


def angle(radians: float, short: bool = False) -> str:
    """Formats an angle in radians and degrees; `short` gives fewer digits."""
    degrees = math.degrees(radians)
    return f"{radians:.3f} ({degrees:.0f}°)" if short else f"{radians:.4f} rad   {degrees:.1f}°"
