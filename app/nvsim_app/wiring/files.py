"""Opens files of every kind, lists recent projects, and switches between the graph files of a folder."""

from __future__ import annotations

import contextlib
import os
from functools import partial
from pathlib import Path

from PySide6.QtCore import QBuffer, QIODevice, QSettings, Qt, QTimer
from PySide6.QtGui import QAction, QImage
from PySide6.QtWidgets import QComboBox, QFileDialog, QMenu

from nvsim.errors import InputError
from nvsim.files.atomic import write_bytes
from nvsim.files.user_folders import home_folder
from nvsim.graph.connectivity import SUFFIX
from nvsim.graph.foreign import saving_message
from nvsim.project.layout import Layout
from nvsim_app.actions import Action
from nvsim_app.drawing.render_child import Picture
from nvsim_app.look.plain_text import CAPTION, caption, plain, tooltip_text
from nvsim_app.look.widgets import named
from nvsim_app.panels.open_dialog import OpenDialog
from nvsim_app.processes.serving import EndMessage
from nvsim_app.processes.side_process import SideProcess
from nvsim_app.state.graph_files import ForeignGraph
from nvsim_app.state.reasons import with_graph_file, with_project, with_scans
from nvsim_app.state.recent_projects import RecentProjects
from nvsim_app.state.side_work import LAST_VIEW, PICTURE, RECENT
from nvsim_app.wiring.new_project import NewProjectPart
from nvsim_app.wiring.part import Part, WindowContext

_FOLDER = "open_folder"


class FilePart(Part):
    """Commands that open and close files."""

    def restore(self, settings: QSettings) -> None:
        self.context.window.start.openWanted.connect(self.choose)

    def choose(self) -> OpenDialog:
        """Opens the dialog that selects what to open."""
        dialog = OpenDialog(self._start(), self.context.window)
        dialog.chosen.connect(self._on_chosen)
        dialog.open()
        return dialog

    def _on_chosen(self, path: Path) -> None:
        self.context.settings.setValue(_FOLDER, str(path.parent))
        self.context.part(NewProjectPart).open_paths([path])

    def _step_scan(self, step: int) -> None:
        file = self.context.document.contents.graph_file
        if isinstance(file, ForeignGraph) and self.context.document.path in file.scans:
            at = file.scans.index(self.context.document.path)
            self.context.window.projectChosen.emit(file.scans[(at + step) % len(file.scans)])

    def choose_picture(self) -> None:
        window = self.context.window
        name, _ = QFileDialog.getSaveFileName(window, "Save image", "view.png", "PNG (*.png)")
        if name:
            window.save_picture(Path(name), self.context.scene)

    def _start(self) -> Path:
        """The folder of the open file, or else the folder that was used last."""
        path = self.context.document.path
        last = Path(str(self.context.settings.value(_FOLDER, "") or home_folder()))
        return path.absolute().parent if path is not None else last if last.is_dir() else home_folder()

    ACTIONS = (
        Action("&File", 0, "open", "&Open…",
               "Open a project, a capture, a video, a navigation graph (R2R connectivity), or a splat file", choose,
               "Ctrl+O", icon="open", toolbar=True),
        Action("&File", 0, "next_scan", "Ne&xt scan", "Open the next connectivity file in the same folder",
               lambda self: self._step_scan(1), "Ctrl+PgDown", with_scans),
        Action("&File", 0, "previous_scan", "Pre&vious scan", "Open the previous connectivity file in the same folder",
               lambda self: self._step_scan(-1), "Ctrl+PgUp", with_scans),
        Action("&File", 0, "refresh", "&Refresh", "Read the project again",
               lambda self: self.context.window.refreshWanted.emit(), "F5", with_project, icon="refresh"),
        Action("&File", 1, "screenshot", "&Save image of the view…", "Save the 3D view as a PNG file", choose_picture,
               "Ctrl+Alt+S", icon="camera"),
        Action("&File", 2, "close_project", "&Close project", "Return to the start page; running jobs continue",
               lambda self: self.context.window.closeWanted.emit(), "Ctrl+W", with_project),
        Action("&File", 2, "quit", "&Quit", "Close the window; running jobs continue",
               lambda self: self.context.window.close(), "Ctrl+Q", icon="quit"),
    )  # fmt: skip


_SOON = 150  # milliseconds


class RecentPart(Part):
    """Lists, opens, and removes recent projects."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.projects = RecentProjects(context.settings)
        self._process = SideProcess(RECENT, self)
        self._process.ended.connect(self._on_looked)
        # Slow work starts after the window is on the screen, and not if a project is opened at once.
        self._soon = QTimer(self, singleShot=True, interval=_SOON)
        self._soon.timeout.connect(self._look_at_projects)
        self._seen: tuple[Picture, QImage] | None = None  # the last sharp image of the open project

    def restore(self, settings: QSettings) -> None:
        window, document = self.context.window, self.context.document
        self._menu = QMenu("Open &recent", window)
        self._menu.aboutToShow.connect(self._fill_menu)
        opening = window.actions_table["open"]
        for menu in window.menuBar().findChildren(QMenu):
            if opening in menu.actions():
                following = menu.actions()[menu.actions().index(opening) + 1]
                menu.insertMenu(following, self._menu)
        window.start.recentWanted.connect(self.open)
        window.start.forgetWanted.connect(self.remove)
        self.context.scene.pictureShown.connect(self._on_picture)
        document.projectLeft.connect(self._keep_view)
        document.projectChanged.connect(self._on_project)
        self._show()

    def store(self, settings: QSettings) -> None:
        self._soon.stop()
        self._process.close()
        self._keep_view()

    def open(self, path: Path) -> None:
        """Opens a project of the list. If it does not exist, a notice says so."""
        if path in self.context.window.start.recent.missing_projects and not path.exists():
            self.context.notices.error(f"{path} does not exist; restore it, or remove it from the list with Del.")
            self._look_at_projects()
        else:
            self.context.window.projectChosen.emit(path)

    def remove(self, path: Path) -> None:
        """Removes a project from the list."""
        self.projects.remove(path)
        self._show()

    def _on_project(self) -> None:
        project = self.context.document.project
        if project is not None:
            self.projects.remember(project)
        self._seen = None
        self._show()

    def _show(self) -> None:
        paths = self.projects.paths
        self.context.window.start.show_recent(paths)
        self._process.close()
        self._soon.start()

    def _look_at_projects(self) -> None:
        paths = self.projects.paths
        if paths and self.context.document.path is None:
            self._process.open(paths)

    def _on_looked(self, end: EndMessage) -> None:
        if end.value is not None:
            self.context.window.start.recent.show_looks(end.value)

    def _fill_menu(self) -> None:
        self._menu.clear()
        for path in self.projects.paths:
            action = QAction(caption(f"{path.name}   {path.parent}"), self._menu)
            action.setToolTip(tooltip_text(path))
            action.triggered.connect(partial(self.open, path))
            self._menu.addAction(action)
        if not self.projects.paths:
            self._menu.addAction("No recent projects").setEnabled(False)

    def _on_picture(self, picture: Picture) -> None:
        scene = self.context.scene
        if not picture.request.moving and scene.feed.channel == "rgb" and scene.feed.image is not None:
            self._seen = picture, scene.feed.image  # the QImage uses the memory of the picture

    def _keep_view(self) -> None:
        """Stores the last view as the thumbnail of the project on the start page."""
        document, seen = self.context.document, self._seen
        project, self._seen = document.project, None
        if seen is None or project is None or document.editing.locked or not os.access(project, os.W_OK):
            return
        wide = Qt.AspectRatioMode.KeepAspectRatioByExpanding
        small = seen[1].scaled(*PICTURE, wide, Qt.TransformationMode.SmoothTransformation)
        buffer = QBuffer()
        buffer.open(QIODevice.OpenModeFlag.WriteOnly)
        small.save(buffer, "JPG", 85)  # type: ignore[call-overload]
        with contextlib.suppress(InputError):  # the user did not ask for the thumbnail
            write_bytes(Layout(project).cache / LAST_VIEW, bytes(buffer.data().data()))


class ForeignPart(Part):
    """Saves copies of a graph file, and switches between the scans of its folder."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.scans = named(QComboBox(context.window, maxVisibleItems=24), "Scan")
        self.scans.setToolTip("The scans of this folder (Ctrl+PgDown, Ctrl+PgUp)")
        self.scans.activated.connect(self._choose)
        self.scans.hide()
        context.document.contentsChanged.connect(self._on_contents)
        context.document.projectChanged.connect(self._on_project)

    def choose_copy(self) -> None:
        file, path = self.context.document.contents.graph_file, self.context.document.path
        if not isinstance(file, ForeignGraph) or path is None:
            return
        stem = path.name.removesuffix(SUFFIX) if path.name.endswith(SUFFIX) else path.stem
        start = str(path.with_name(f"{stem}-edited{SUFFIX}"))
        pattern = f"Connectivity (*{SUFFIX})"
        name, _ = QFileDialog.getSaveFileName(self.context.window, "Save the graph as", start, pattern)
        if name:
            self.save_copy(Path(name))

    def save_copy(self, path: Path) -> None:
        """Writes the graph to another file and opens it. Unsaved edits are only in the copy."""
        document, editing = self.context.document, self.context.document.editing
        file, history = document.contents.graph_file, editing.history
        if not isinstance(file, ForeignGraph) or history is None:
            return
        if path.suffix.lower() != ".json":
            path = path.with_name(path.name + SUFFIX)
        if document.path is not None and path.exists() and path.samefile(document.path):
            editing.save()
            return
        with self.context.notices.reporting(about="save graph"):
            file.save_copy(history.graph, path)
            self.context.notices.info(saving_message(path, None, history.graph), about="save graph")
            if editing.writable and history.saved_index >= 0:
                history.go_to(history.saved_index)  # otherwise the next opening would restore the edits
            self.context.window.projectChosen.emit(path)

    def restore(self, settings: QSettings) -> None:
        self.context.window.statusBar().addPermanentWidget(self.scans)
        self.scans.hide()

    def _on_project(self) -> None:
        self.scans.hide()

    def _on_contents(self, parts: frozenset[str]) -> None:
        contents = self.context.document.contents
        file = contents.graph_file
        if "graph" in parts and isinstance(file, ForeignGraph) and len(file.scans) > 1:
            self.scans.clear()
            for path in file.scans:
                self.scans.addItem(plain(path.name.removesuffix(SUFFIX), CAPTION), path)
            self.scans.setCurrentIndex(file.scans.index(contents.path) if contents.path in file.scans else -1)
            self.scans.show()

    def _choose(self, row: int) -> None:
        self.context.window.projectChosen.emit(self.scans.itemData(row))

    ACTIONS = (
        Action("&File", 1, "save_as", "Save &as…",
               "Write the graph to another file and open it; the current file keeps its last saved state", choose_copy,
               "Ctrl+Shift+S", with_graph_file),
    )  # fmt: skip
