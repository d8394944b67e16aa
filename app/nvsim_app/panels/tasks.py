"""The tasks of a scan: a list with filters and keys, and the instructions of the selected task."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import QEvent, QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtGui import QHideEvent, QKeyEvent, QResizeEvent, QShowEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QComboBox,
    QLineEdit,
    QMenu,
    QPlainTextEdit,
    QPushButton,
    QSizePolicy,
    QSlider,
    QToolButton,
    QWidget,
)

from nvsim.r2r.reviewing import Episode, Key, Review, TaskEntry
from nvsim_app.look import colors, lengths
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.table import Column, TableModel, TableView, style_table
from nvsim_app.look.theme import GRID
from nvsim_app.look.widgets import named, tool_button

_KEYS = {Qt.Key.Key_A: "accepted", Qt.Key.Key_R: "rejected"}
_WALK = 600  # milliseconds per step while the path is walked
_PAUSE = 1500  # milliseconds without a key press until typed text is stored
_ROWS = 3  # rows that are visible before they get two lines
_FEWEST = 2  # rows that the smallest list shows
_READABLE = 400  # width of an instruction before optional columns are shown, pixels
_WIDE = 600  # width from which the editor is beside the list, pixels
_EPISODE = (5, 6)  # columns of the results of an agent
_DIGITS = range(Qt.Key.Key_0, Qt.Key.Key_9 + 1)
_TAKEN = {*_KEYS, *_DIGITS, *(getattr(Qt.Key, f"Key_{name}") for name in ("E", "Return", "Left", "Right", "Space"))}


class TaskModel(TableModel[TaskEntry]):
    """One row for each task that passes the filters."""

    def __init__(self) -> None:
        columns: tuple[Column[TaskEntry], ...] = (
            Column("Split", lambda entry: entry.split.removeprefix("R2R_"), width=80, optional=True),
            Column("Path", lambda entry: entry.task.path_id, number=True, width=48),
            Column("Edges", lambda entry: len(entry.task.path) - 1, number=True, width=56, optional=True),
            Column("Meters", lambda entry: entry.task.distance, _tenths, number=True, width=64,
                   optional=True),
            Column("State", self._state, width=72, ink=self._ink),
            Column("NE", lambda entry: None if (did := self.episode(entry)) is None else did.ne, _tenths, number=True,
                   width=48),
            Column("SPL", lambda entry: None if (did := self.episode(entry)) is None else did.spl,
                   lambda spl: "" if spl is None else f"{spl:.2f}", number=True, width=48),
            Column("Instruction", self._instruction, width=_READABLE),
        )  # fmt: skip
        super().__init__(columns, about=self._fault)
        self.review = Review()
        self.faults: Mapping[Key, str] = {}
        self._episodes: Mapping[str, Episode] = {}
        self._worst: dict[Key, Episode | None] = {}

    @property
    def episodes(self) -> Mapping[str, Episode]:
        return self._episodes

    @episodes.setter
    def episodes(self, found: Mapping[str, Episode]) -> None:
        self._episodes, self._worst = found, {}

    def episode(self, entry: TaskEntry, which: int = 0) -> Episode | None:
        """The episode of instruction `which`, counted from 1; 0 selects the worst episode of the task."""
        if which or not self.episodes:
            return self.episodes.get("".join(entry.task.instr_ids[which - 1 : which]))
        if entry.key not in self._worst:
            found = [self.episodes[id] for id in entry.task.instr_ids if id in self.episodes]
            self._worst[entry.key] = max(found, key=lambda e: (e.ne, -e.spl), default=None)
        return self._worst[entry.key]

    def _fault(self, entry: TaskEntry) -> str:
        fault = self.faults.get(entry.key, "")
        return f"Broken: {fault}" if fault else ""

    def _state(self, entry: TaskEntry) -> str:
        verdict = self.review[entry.key]
        edited = " *" if verdict.instructions is not None else ""
        return "broken" if self.faults.get(entry.key) else f"{verdict.state}{edited}"

    def _ink(self, entry: TaskEntry) -> str:
        bad = self.faults.get(entry.key) or self.review[entry.key].state == "rejected"
        return colors.text("blocked" if bad else "open")

    def _instruction(self, entry: TaskEntry) -> str:
        texts = self.review.reviewed(entry.key, entry.task).instructions
        return texts[0] if texts else ""


def _tenths(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _is_ours(event: QKeyEvent) -> bool:
    return event.key() in _TAKEN and event.modifiers() == Qt.KeyboardModifier.NoModifier


class _Table(TableView):
    """The list of tasks, with its own keys. Rows have two lines of the instruction if `_ROWS` of them fit, else one."""

    pressed_key = Signal(int)
    _heights = (0, 0)

    def set_line_heights(self, one: int, two: int) -> None:
        """Sets the heights of a row with one and with two lines of text, pixels."""
        self._heights = one, two
        self.setMinimumHeight(_FEWEST * one + self.horizontalHeader().sizeHint().height() + 2 * self.frameWidth())

    def resizeEvent(self, event: QResizeEvent) -> None:
        one, two = self._heights
        if two:
            self.verticalHeader().setDefaultSectionSize(two if self.viewport().height() >= _ROWS * two else one)
        super().resizeEvent(event)

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent) and _is_ours(event):
            event.accept()  # the keys of the list override those of the window
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if _is_ours(event):
            self.pressed_key.emit(event.key())
        else:
            super().keyPressEvent(event)


class TaskPanel(QWidget):
    """The list of tasks, and an editor for their instructions.

    opened(), picked(), played(), undone(), exported(): a button was clicked. chosen(): another task, or none, was
    selected. judged(state), written(texts): about the selected task. stepped(int): the step of the path or trajectory
    to go to. visited(): show the whole path.
    """

    opened, picked, played, undone, exported, chosen, visited = (Signal() for _ in range(7))
    judged, written, stepped = Signal(str), Signal(list), Signal(int)

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("taskPanel")
        self.model, self.entries = TaskModel(), tuple[TaskEntry, ...]()
        self._lower: dict[Key, str] = {}  # instructions in lower case, for the filter
        self.text, self.split, self.state, self.order = QLineEdit(), QComboBox(), QComboBox(), QComboBox()
        self.text.setAccessibleName("Filter by words or path id")
        for choice, name in ((self.split, "Split"), (self.state, "State"), (self.order, "Order")):
            choice.setAccessibleName(name)
        self.text.setPlaceholderText("Filter by words or path id")
        self.which = named(QComboBox(), "Trajectory")
        self.which.setToolTip(
            tooltip_text("Instruction whose trajectory is drawn and walked; 0 to 9 in the list select it")
        )
        self.state.addItems(["Any state", "Unread", "Accepted", "Rejected", "Edited", "Broken"])
        self.order.addItems(["In order", "Worst first"])
        self.split.addItem("All splits")
        self.table = _Table()
        self.table.setModel(self.model)
        style_table(self.table, "Tasks")
        self.table.setColumnWidth(self.model.columnCount() - 1, 0)  # the last column takes the rest
        self.table.setWordWrap(True)
        self.table.set_line_heights(
            self.table.verticalHeader().defaultSectionSize(), 2 * self.table.fontMetrics().lineSpacing() + GRID
        )
        self.words = Label("Open a folder of task files, such as R2R_train.json.", wordWrap=True)
        self.editor = QPlainTextEdit(tabChangesFocus=True, placeholderText="One instruction per line")
        self.editor.setAccessibleName("Instructions of the task")
        self.editor.setMinimumHeight(32)
        self.editor.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Ignored)
        self.slider = named(QSlider(Qt.Orientation.Horizontal), "Position on the path")
        self.slider.setMinimumWidth(40)
        tip = "Open tasks or trajectories, export the accepted tasks, undo the last verdict"
        self.files = tool_button("Tasks", None, tip=tip, popupMode=QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(self.files)
        for text, signal in (("Open folder…", self.opened), ("Open files…", self.picked),
                             ("Open trajectories…", self.played), ("Undo", self.undone),
                             ("Export accepted", self.exported)):  # fmt: skip
            menu.addAction(text).triggered.connect(lambda _=False, signal=signal: signal.emit())
        self.files.setMenu(menu)
        for choice in (self.split, self.state, self.order, self.which):
            choice.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
            choice.setMinimumContentsLength(7)
        self.walk = QPushButton("Walk")
        self.walk.setCheckable(True)
        self.walk.setToolTip(
            tooltip_text("Walk the path, or the trajectory, one viewpoint at a time (Space in the list)")
        )
        self._filters = hbox(
            (hbox(self.files, (self.text, 1), spacing=GRID), 1),
            hbox((self.split, 1), (self.state, 1), (self.order, 1), spacing=GRID),
            spacing=GRID,
        )
        listed = vbox(self._filters, (self.table, 1), spacing=GRID)
        walking = hbox(self.walk, (self.slider, 1), self.which, spacing=GRID)
        selected = vbox(self.words, (self.editor, 1), walking, spacing=GRID)
        self._parts = hbox((listed, 2), (selected, 1), on=self, margins=(GRID, 4, GRID, 4), spacing=GRID)
        self.text.textChanged.connect(self.refilter)
        for choice in (self.split, self.state, self.order):
            choice.currentIndexChanged.connect(self.refilter)
        self.table.selectionModel().currentRowChanged.connect(lambda *_: self._on_row())
        self.table.pressed_key.connect(self._on_key)
        self.slider.valueChanged.connect(self.stepped)
        self._pace = QTimer(self, interval=_WALK)
        self._pace.timeout.connect(self._go_on)
        self.walk.toggled.connect(self._set_walking)
        self.which.currentIndexChanged.connect(self._on_which)
        self._show_controls_of_trajectories()
        self._typed = QTimer(self, singleShot=True, interval=_PAUSE)
        self._typed.timeout.connect(self.keep)
        self.editor.textChanged.connect(self._typed.start)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Puts the editor beside the list if there is room, else below it."""
        across, down = QBoxLayout.Direction.LeftToRight, QBoxLayout.Direction.TopToBottom
        for box in (self._parts, self._filters):
            box.setDirection(across if self.width() >= _WIDE else down)
        super().resizeEvent(event)

    def showEvent(self, event: QShowEvent) -> None:
        """The views show the path while the panel is visible."""
        super().showEvent(event)
        self.chosen.emit()

    def hideEvent(self, event: QHideEvent) -> None:
        super().hideEvent(event)
        self.chosen.emit()

    @property
    def current(self) -> TaskEntry | None:
        row = self.table.currentIndex().row()
        return self.model.row(row) if 0 <= row < self.model.rowCount() else None

    @property
    def shown(self) -> Episode | None:
        """The agent's episode for the selected instruction of the selected task."""
        entry = self.current
        return None if entry is None else self.model.episode(entry, max(0, self.which.currentIndex()))

    def show_entries(self, entries: tuple[TaskEntry, ...], review: Review) -> None:
        self.entries, self.model.review = entries, review
        self._lower = {e.key: "\n".join(e.task.instructions).lower() for e in entries}
        with QSignalBlocker(self.split):
            self.split.clear()
            self.split.addItems(["All splits", *sorted({e.split for e in entries})])
        self.refilter()

    def refilter(self, _: object = None) -> None:
        """Lists the tasks that pass the filters. Keeps the selected task if it is among them."""
        before, model = self.current, self.model
        self._show_controls_of_trajectories()
        self.table.fit()
        words, split, wanted = self.text.text().lower(), self.split.currentText(), self.state.currentText().lower()
        split = split if self.split.currentIndex() > 0 else ""
        rows = [e for e in self.entries if self._passes_filters(e, words, split, wanted)]
        if self.order.currentIndex() == 1:
            rows.sort(key=lambda e: -d.ne if (d := model.episode(e)) else 1.0)
        if rows == model.rows and before is not None:  # keep typed text and the step
            self.table.viewport().update()
            self._steps()
            self.show_summary()
            self.chosen.emit()
            return
        model.show(rows)
        if rows:
            self.table.selectRow(rows.index(before) if before in rows else 0)
        else:
            self._on_row()

    def _show_controls_of_trajectories(self) -> None:
        for column in _EPISODE:
            self.table.setColumnHidden(column, not self.model.episodes)
        self.order.setVisible(bool(self.model.episodes))
        self.which.setVisible(bool(self.model.episodes))

    def refresh(self) -> None:
        """Updates the list after states, faults, or episodes changed."""
        if self.state.currentIndex() or self.order.currentIndex():
            self.refilter()
        else:
            self.table.viewport().update()
        self.show_summary()

    def _passes_filters(self, entry: TaskEntry, words: str, split: str, wanted: str) -> bool:
        if split and entry.split != split:
            return False
        verdict = self.model.review[entry.key]
        states = {"any state": True, "unread": not verdict.state, "edited": verdict.instructions is not None}
        if wanted == "broken":
            states[wanted] = bool(self.model.faults.get(entry.key))
        if not states.get(wanted, wanted == verdict.state):
            return False
        if not words or str(entry.task.path_id) == words:
            return True
        return words in (self._lower[entry.key] if verdict.instructions is None else self._rewritten(entry))

    def _rewritten(self, entry: TaskEntry) -> str:
        return "\n".join(self.model.review.reviewed(entry.key, entry.task).instructions).lower()

    def _on_row(self) -> None:
        self.keep()
        self.edited = self.current
        self.walk.setChecked(False)
        self._list_instructions()
        self.fill()
        self._steps(0)
        self.show_summary()
        self.chosen.emit()

    def fill(self) -> None:
        """Shows the stored instructions of the selected task in the editor."""
        entry = self.edited
        texts = () if entry is None else self.model.review.reviewed(entry.key, entry.task).instructions
        self.editor.setPlainText("\n".join(texts))
        self.editor.document().setModified(False)

    def _steps(self, at: int | None = None) -> None:
        """Sets the range of the slider to the trajectory or the path, and its value to `at`; None keeps the value."""
        entry, did = self.current, self.shown
        with QSignalBlocker(self.slider):
            self.slider.setRange(0, len(did.poses if did else entry.task.path) - 1 if entry else 0)
            self.slider.setValue(self.slider.value() if at is None else at)

    def _list_instructions(self) -> None:
        """Lists the worst instruction of the task and each one. Keeps the selected number if it exists."""
        count = 0 if self.current is None else len(self.current.task.instr_ids)
        before = self.which.currentIndex()
        with QSignalBlocker(self.which):
            self.which.clear()
            self.which.addItems(["Worst instruction", *(f"Instruction {k + 1}" for k in range(count))])
            self.which.setCurrentIndex(before if 0 <= before <= count else 0)

    def _on_which(self) -> None:
        self._steps(0)
        self.show_summary()
        self.chosen.emit()

    def _set_walking(self, on: bool) -> None:
        """Starts at the current step, or at the first step if the walk had ended."""
        if on and self.slider.value() == self.slider.maximum():
            self.slider.setValue(0)
        if on:
            self._pace.start()
        else:
            self._pace.stop()

    def _go_on(self) -> None:
        self.slider.setValue(self.slider.value() + 1)
        if self.slider.value() >= self.slider.maximum():
            self.walk.setChecked(False)

    edited: TaskEntry | None = None  # the task whose instructions are in the editor

    def keep(self) -> None:
        """Emits the typed instructions if they changed."""
        if self.edited is not None and self.editor.document().isModified():
            self.editor.document().setModified(False)
            self.written.emit([t.strip() for t in self.editor.toPlainText().splitlines() if t.strip()])

    def show_summary(self) -> None:
        """Shows a summary of the selected task."""
        entry = self.current
        if entry is None:
            return
        fault, did, which = self.model.faults.get(entry.key, ""), self.shown, self.which.currentIndex()
        parts = [f"{self.model.rowCount():,} of {len(self.entries):,} tasks", f"Broken: {fault}" if fault else ""]
        if did is not None:
            whose = f"Instruction {which}: " if which > 0 else ""
            outcome = "success" if did.success else "failure"
            parts.append(f"{whose}{outcome}, NE {lengths.length(did.ne)}, SPL {did.spl:.2f}")
        self.words.setText(". ".join(p for p in parts if p) + ".")

    def _on_key(self, key: int) -> None:
        if key == Qt.Key.Key_E:
            self.editor.setFocus()
        elif key == Qt.Key.Key_Return:
            self.visited.emit()
        elif key == Qt.Key.Key_Space:
            self.walk.toggle()
        elif key in _DIGITS:
            if key - _DIGITS[0] < self.which.count():
                self.which.setCurrentIndex(key - _DIGITS[0])
        elif key in (Qt.Key.Key_Left, Qt.Key.Key_Right):
            self.slider.setValue(self.slider.value() + (1 if key == Qt.Key.Key_Right else -1))
        else:
            self.judged.emit(_KEYS[Qt.Key(key)])
