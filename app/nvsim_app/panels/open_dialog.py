"""The dialog that opens projects and files: a line for a path, and the contents of its folder with their kinds."""

from __future__ import annotations

import threading
from functools import partial
from pathlib import Path

from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QIcon, QKeyEvent
from PySide6.QtWidgets import QDialogButtonBox, QLineEdit, QPushButton, QStyle, QWidget

from nvsim.files.user_folders import home_folder
from nvsim.project.path_kind import PathKind
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Hint, Label
from nvsim_app.look.plain_text import plain
from nvsim_app.look.table import Column, TableModel, table
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import Dialog, DialogButtons, push_button
from nvsim_app.processes.background import BackgroundWork
from nvsim_app.state.folder_listing import Entry, Listing, list_folder

_TYPING = 120  # milliseconds after the last key press until the folder is read
_WORDS: dict[PathKind, str] = {
    "project": "project",
    "capture": "capture",
    "video": "video",
    "graph": "graph",
    "graph folder": "folder of graphs",
    "splats": "splats",
}
_OPENS: dict[PathKind, str] = {
    "project": "A project: NVSim opens it.",
    "capture": "A capture: NVSim checks it and creates a project from it.",
    "video": "A video: NVSim computes its camera poses and creates a project from it.",
    "graph": "A navigation graph (R2R connectivity): NVSim opens it without a project.",
    "graph folder": "A folder of navigation graphs (R2R connectivity): NVSim opens the first; you can select another.",
    "splats": "A splat file: NVSim opens it without a project.",
}


class OpenDialog(Dialog):
    """Selects a file or folder to open. chosen(Path): the user opened it."""

    chosen = Signal(object)

    def __init__(self, folder: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Open")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.listing: Listing | None = None
        self._trouble = ""
        self._waiting = BackgroundWork("folder", self)
        self._stopped = threading.Event()  # ends the running listing
        self._due = QTimer(self, singleShot=True, interval=_TYPING)
        self._due.timeout.connect(self._list_folder)
        self.line = QLineEdit(
            self, placeholderText="The path of a project, a capture, a video, a graph or a splat file"
        )
        self.line.setAccessibleName("Path")
        self.line.textEdited.connect(self._on_typed)
        self.line.installEventFilter(self)
        self.up = push_button("Up", self, self.go_up, "Go to the parent folder (Alt+Up)")
        self.up.setShortcut("Alt+Up")
        columns = (
            Column[Entry]("Name", lambda entry: entry.path.name, width=480, icon=self._icon),
            Column[Entry]("Kind", lambda entry: _WORDS.get(entry.kind, "folder"), ink=self._ink),
        )
        self.model: TableModel[Entry] = TableModel(columns, self, about=lambda entry: str(entry.path))
        self.list = table(self.model, self, "Contents of the folder")
        self.list.selectionModel().selectionChanged.connect(self._update_target)
        self.list.doubleClicked.connect(self.open_target)
        self.list.installEventFilter(self)
        self._hint = Hint(self.list, self._reason_for_no_entries).refresh_with(self.list)
        self.says = Label(self, wordWrap=True, font=type_font(bold=True))
        self.rest = Label(self, quiet=True)
        buttons = DialogButtons(self)
        self.ok = buttons.addButton("Open", QDialogButtonBox.ButtonRole.AcceptRole)
        self.inside = buttons.addButton("Show contents", QDialogButtonBox.ButtonRole.ActionRole)
        self.inside.setToolTip("Show the contents of the selected folder (Right)")
        buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.ok.clicked.connect(self.open_target)
        self.inside.clicked.connect(self._go_inside)
        buttons.rejected.connect(self.reject)
        for button in self.findChildren(QPushButton):
            button.setAutoDefault(False)  # the line and the list handle Enter
        head = hbox((self.line, 1), self.up)
        vbox(head, (self.list, 1), self.rest, self.says, buttons, on=self)
        self.resize(720, 480)
        self.go_to(folder)

    # Folder -------------------------------------------------------------------------------------------------------

    @property
    def folder(self) -> Path:
        """The folder that is listed or will be listed next."""
        text = self.line.text().strip()
        path = Path(text).expanduser() if text else home_folder()
        return path if text.endswith(("/", "\\")) or not text else path.parent

    def go_to(self, folder: Path) -> None:
        """Lists the contents of a folder."""
        text = str(folder)
        self.line.setText(text if text.endswith("/") else f"{text}/")
        self._list_folder()

    def go_up(self) -> None:
        self.go_to(self.folder.parent)

    def _on_typed(self, _: str) -> None:
        self._due.start()

    def _list_folder(self) -> None:
        """Lists the folder of the line, unless it is already shown."""
        self._due.stop()
        if self.listing is not None and self.listing.folder == self.folder:
            self._fill()
            return
        self.listing, self._trouble = None, ""
        self._stopped.set()
        self._stopped = threading.Event()
        work = partial(list_folder, self.folder, self._stopped)
        self._waiting.start(work, self._on_listed, self._on_trouble)
        self._fill()

    def _on_listed(self, found: Listing | None) -> None:
        self.listing = found
        self._fill()

    def _on_trouble(self, trouble: str) -> None:
        self._trouble = trouble
        self._fill()

    # Listing ------------------------------------------------------------------------------------------------------

    def _fill(self) -> None:
        """Shows the entries whose names contain the typed text."""
        listing, typed = self.listing, self._typed.casefold()
        entries = () if listing is None else listing.entries
        self.model.show([entry for entry in entries if typed in entry.path.name.casefold()])
        names = [entry.path.name.casefold() for entry in self.model.rows]
        self.list.setCurrentIndex(self.model.index(names.index(typed) if typed in names else -1, 0))
        words = []
        if listing is not None and listing.others:
            words.append(f"{listing.others:,} file{'' if listing.others == 1 else 's'} that NVSim cannot open")
        if listing is not None and listing.cut:
            words.append("the folder has more entries than are listed; type a path")
        self.rest.setText("; ".join(words))
        self._hint.refresh()
        self._update_target()

    def _icon(self, entry: Entry) -> QIcon:
        icon = QStyle.StandardPixmap.SP_DirIcon if entry.is_folder else QStyle.StandardPixmap.SP_FileIcon
        return self.style().standardIcon(icon)

    def _ink(self, entry: Entry) -> str:
        return "" if entry.openable else self.palette().placeholderText().color().name()

    @property
    def _typed(self) -> str:
        """The incomplete name at the end of the line."""
        text = self.line.text().strip()
        return "" if not text or text.endswith(("/", "\\")) else Path(text).name

    def _reason_for_no_entries(self) -> str:
        if self.model.rowCount():
            return ""
        if self._trouble:
            return self._trouble
        return "…" if self.listing is None else "This folder has nothing that NVSim can open."

    @property
    def entry(self) -> Entry | None:
        """The selected entry of the list."""
        rows = self.list.selectionModel().selectedRows()
        return self.model.row(rows[0].row()) if rows else None

    @property
    def target(self) -> tuple[Path, PathKind] | None:
        """The path and kind that Open opens: the selected entry, or the listed folder. None if it cannot be opened."""
        if self.entry is not None:
            return (self.entry.path, self.entry.kind) if self.entry.openable else None
        listing = self.listing
        if listing is None or self._typed or listing.kind not in _OPENS:
            return None
        return listing.folder, listing.kind

    def _update_target(self, *_: object) -> None:
        target = self.target
        inside = self.entry is not None and self.entry.is_folder
        self.ok.setEnabled(target is not None)
        self.inside.setEnabled(inside)
        if target is not None:
            self.says.setText(f"{plain(target[0].name)} – {_OPENS[target[1]]}")
        else:
            self.says.setText("A folder. Press Enter to show its contents." if inside else "Select what to open.")

    # Choosing -----------------------------------------------------------------------------------------------------

    def open_target(self, *_: object) -> None:
        """Opens the target. Without a target, shows the contents of the selected folder."""
        target = self.target
        if target is not None:
            self.accept()
            self.chosen.emit(target[0])
        else:
            self._go_inside()

    def _choose_first(self) -> None:
        self.list.setCurrentIndex(self.model.index(0, 0))

    def _go_inside(self) -> None:
        if self.entry is not None and self.entry.is_folder:
            self.go_to(self.entry.path)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            key = event.key()
            if key in (Qt.Key.Key_Return, Qt.Key.Key_Enter):
                if self._due.isActive() or self._waiting.busy:
                    return True  # the folder of the line has not been read yet
                if watched is self.line and self.entry is None and self.model.rowCount() == 1 and self._typed:
                    self._choose_first()
                self.open_target()
                return True
            if watched is self.line and key in (Qt.Key.Key_Down, Qt.Key.Key_PageDown):
                self.list.setFocus()
                if self.entry is None:
                    self._choose_first()
                return True
            if watched is self.list and key == Qt.Key.Key_Right:
                self._go_inside()
                return True
            if watched is self.list and key in (Qt.Key.Key_Left, Qt.Key.Key_Backspace):
                self.go_up()
                return True
        return super().eventFilter(watched, event)

    def done(self, code: int) -> None:
        self._due.stop()
        self._stopped.set()
        self._waiting.stop()
        super().done(code)
