"""The window of networks: installed and known networks, their authors, and their benefits. A side process lists, tests,
and installs them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Qt, QUrl, Signal
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QDialogButtonBox,
    QFileDialog,
    QPlainTextEdit,
    QPushButton,
    QSplitter,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from nvsim.files.user_folders import home_folder
from nvsim.networks.description import SINGLE_FILES
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import Dialog, DialogButtons, named
from nvsim_app.processes.serving import EndMessage
from nvsim_app.processes.side_process import SideProcess
from nvsim_app.state.side_work import MODELS, Found, ModelTask

_ROW = Qt.ItemDataRole.UserRole
_INTRO = (
    "NVSim neither includes nor downloads networks. Networks that you install here improve floor masks, the map, and "
    "mask corrections. Everything works without them."
)
_NOT_INSTALLED = "Select an installed network to test it"


class ModelsWindow(Dialog):
    """A non-modal window that lists, installs, and tests networks."""

    def __init__(self, models: InstalledModels, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._models = models
        self.setWindowTitle("Networks")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        intro, self.folder, self.state = Label(_INTRO, self), Label(self), Label(self)
        for label in (intro, self.folder, self.state):
            label.setWordWrap(True)
        self.folder.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.tree = named(QTreeWidget(self), "Networks")
        self.tree.setHeaderLabels(["Network", "State"])
        self.tree.setRootIsDecorated(False)
        self.tree.currentItemChanged.connect(lambda *_: self._show_row())
        self.details = named(QPlainTextEdit(self, readOnly=True), "About the network")
        both = QSplitter(self, childrenCollapsible=False)
        both.addWidget(self.tree)
        both.addWidget(self.details)
        both.setSizes([390, 550])
        buttons = DialogButtons(QDialogButtonBox.StandardButton.Close, self)
        about = "Select the ONNX files of one network; NVSim copies them"
        self.add_button = self._button(buttons, "Install…", about, self._add)
        self.check_button = self._button(buttons, "Test", "", self._check)
        self.open_button = self._button(buttons, "Open folder", "Open the folder of the networks", self._open_folder)
        buttons.rejected.connect(self.close)
        below = hbox((self.state, 1), buttons)
        vbox(intro, self.folder, (both, 1), below, on=self, spacing=8)
        self.resize(940, 560)
        models.changed.connect(self._refresh)
        models.failed.connect(self._show_state)
        self._refresh()

    def _button(self, box: QDialogButtonBox, words: str, about: str, do: Callable[[], object]) -> QPushButton:
        button = box.addButton(words, QDialogButtonBox.ButtonRole.ActionRole)
        button.setToolTip(tooltip_text(about) if about else "")
        button.setAutoDefault(False)
        button.clicked.connect(lambda: do())
        return button

    # Display ------------------------------------------------------------------------------------------------------

    def _refresh(self) -> None:
        found, chosen = self._models.found, self._name_of(self.tree.currentItem())
        self.folder.setText(f"Networks are stored in {found['folder']}" if found else "")
        self.tree.clear()
        if found:
            self._group("Installed", [self._installed(row) for row in found["models"]] or [_placeholder_item()])
            for lacking in found["lacking"]:
                rows = [_known(row, lacking) for row in lacking["known"]]
                self._group(f"Not installed: {lacking['role']}", rows)
        self.tree.expandAll()
        self.tree.resizeColumnToContents(0)
        self.tree.setColumnWidth(0, min(self.tree.columnWidth(0), 300))
        self._choose(self._models.added or chosen)
        self._models.added = ""
        problems = found.get("problems", [])
        self._show_state(self._models.doing or (problems[0] if problems else ""))
        self._update_buttons()

    def _group(self, title: str, rows: list[QTreeWidgetItem]) -> None:
        head = QTreeWidgetItem(self.tree, [title])
        head.setFirstColumnSpanned(True)
        head.setFlags(Qt.ItemFlag.ItemIsEnabled)
        head.setFont(0, type_font(bold=True))
        head.addChildren(rows)

    def _installed(self, row: dict[str, Any]) -> QTreeWidgetItem:
        checked = self._models.checked.get(row["name"])
        state = "installed" if checked is None else "does not work" if checked["problem"] else "works"
        lines = [row["title"], f"Provides {row['role']}.", f"Improves {row['improves']}."]
        lines += [f"{words}: {row[key]}" for words, key in (("Made by", "made_by"), ("License", "licence")) if row[key]]
        lines += [row["source"], f"{row['megabytes']:,.1f} MB: {', '.join(row['files'])}"]
        if checked is not None:
            says = f"Tested: {checked['says']}, {1000 * checked['seconds']:.0f} ms per image."
            lines.append(checked["problem"] or says)
        item = QTreeWidgetItem([row["name"], state])
        may_be_tried = row["role"] not in SINGLE_FILES  # the commands that use the others test them
        item.setData(0, _ROW, {"name": row["name"], "lines": lines, "installed": may_be_tried})
        return item

    def _choose(self, name: str) -> None:
        items = [group.child(i) for group in self._groups() for i in range(group.childCount())]
        wanted = next((item for item in items if self._name_of(item) == name), None)
        self.tree.setCurrentItem(wanted or (items[0] if items else None))  # type: ignore[arg-type]

    def _groups(self) -> list[QTreeWidgetItem]:
        found = (self.tree.topLevelItem(i) for i in range(self.tree.topLevelItemCount()))
        return [group for group in found if group is not None]

    def _name_of(self, item: QTreeWidgetItem | None) -> str:
        row = None if item is None else item.data(0, _ROW)
        return "" if row is None else str(row["name"])

    def _show_row(self) -> None:
        item = self.tree.currentItem()
        row = None if item is None else item.data(0, _ROW)
        self.details.setPlainText("\n\n".join(filter(None, row["lines"])) if row else "")
        self._update_buttons()

    def _update_buttons(self) -> None:
        item = self.tree.currentItem()
        row = None if item is None else item.data(0, _ROW)
        busy = self._models.doing
        why = busy or ("" if row and row["installed"] else _NOT_INSTALLED)
        self.check_button.setEnabled(not why)
        self.check_button.setToolTip(tooltip_text(why or "Load the network and run it on an image"))
        self.add_button.setEnabled(not busy)
        self.open_button.setEnabled(bool(self._models.found))

    def _show_state(self, words: str) -> None:
        self.state.setText(words)

    # Actions ------------------------------------------------------------------------------------------------------

    def _add(self) -> None:
        names, _ = QFileDialog.getOpenFileNames(
            self,
            "Select the ONNX files of one network, and its TOML file if it has one",
            str(home_folder()),
            "Networks (*.onnx *.toml)",
        )
        if names:
            self._models.add([Path(name) for name in names])

    def _check(self) -> None:
        self._models.check([self._name_of(self.tree.currentItem())])

    def _open_folder(self) -> None:
        folder = Path(self._models.found["folder"])
        if folder.is_dir():
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))
        else:
            self._show_state(f"{folder} is created when the first network is installed.")


def _known(row: dict[str, Any], lacking: dict[str, Any]) -> QTreeWidgetItem:
    lines = [row["title"], f"Would improve {lacking['improves']}.", f"Networks: {', '.join(row['names'])}."]
    lines += [f"Made by: {row['made_by']}", f"License: {row['licence']}", f"From {row['source']}"]
    item = QTreeWidgetItem([row["form"], "not installed"])
    item.setData(0, _ROW, {"name": row["form"], "lines": lines, "installed": False})
    return item


def _placeholder_item() -> QTreeWidgetItem:
    item = QTreeWidgetItem(["no network yet", ""])
    item.setData(0, _ROW, {"name": "", "lines": ["Select Install… to add one."], "installed": False})
    return item


class InstalledModels(QObject):
    """The catalog of networks.

    changed()     a task started or ended
    failed(str)   a sentence for the user
    """

    changed = Signal()
    failed = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.found: Found = {}
        """The last catalog, {} if it was not listed yet."""
        self.checked: Found = {}
        """Result of the last test of each model, by name."""
        self.added = ""
        """The name of the last installed model."""
        self.doing = ""
        """The current task as text, "" if there is none."""
        self._process = SideProcess(MODELS, self)
        self._process.ended.connect(self._on_ended)

    def list(self) -> None:
        """Lists all models."""
        self._start(ModelTask(), "Listing the models…")

    def check(self, names: Sequence[str]) -> None:
        """Tests models on an image."""
        self._start(ModelTask(check=tuple(names)), f"{', '.join(names)}: testing…")

    def add(self, paths: Sequence[Path]) -> None:
        """Installs the files of one model."""
        self._start(ModelTask(add=tuple(path.absolute() for path in paths)), "Testing and copying the model…")

    def stop(self) -> None:
        """Ends the current task, and returns after it has ended."""
        self._process.close()
        self.doing = ""

    def _start(self, task: ModelTask, words: str) -> None:
        self._process.open(task)
        self.doing = words
        self.changed.emit()

    def _on_ended(self, end: EndMessage) -> None:
        self.doing = ""
        found: Found | None = end.value
        if found is not None:
            self.found = found["catalogue"]
            self.checked |= found["checked"]
            if found["added"]:
                self.added = found["added"]
                self.checked.pop(self.added, None)
        self.changed.emit()
        if end.sentence:
            self.failed.emit(end.sentence)
