"""Recent projects: in the menu, and on the start page with thumbnails, which another process reads."""

from __future__ import annotations

import contextlib
import os
from functools import partial
from pathlib import Path

from PySide6.QtCore import QBuffer, QIODevice, QSettings, Qt, QTimer
from PySide6.QtGui import QAction, QImage
from PySide6.QtWidgets import QMenu

from app.drawing.render_child import Picture
from app.look.plain_text import caption, tip
from app.processes.serving import Ended
from app.processes.side_process import SideProcess
from app.state.recent_child import LAST_VIEW, PICTURE, RECENT
from app.state.recent_projects import RecentProjects
from app.wiring.part import Part, WindowContext
from nvsim.errors import InputError
from nvsim.files.atomic import write_bytes
from nvsim.project.layout import Layout

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
        self._soon.timeout.connect(self._look)
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
        window.start.forgetWanted.connect(self.forget)
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
        if path in self.context.window.start.recent.gone and not path.exists():
            self.context.notices.error(f"{path} does not exist; restore it, or remove it from the list with Del.")
            self._look()
        else:
            self.context.window.projectChosen.emit(path)

    def forget(self, path: Path) -> None:
        """Removes a project from the list."""
        self.projects.forget(path)
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

    def _look(self) -> None:
        paths = self.projects.paths
        if paths and self.context.document.path is None:
            self._process.open(paths)

    def _on_looked(self, end: Ended) -> None:
        if end.value is not None:
            self.context.window.start.show_looks(end.value)

    def _fill_menu(self) -> None:
        self._menu.clear()
        for path in self.projects.paths:
            action = QAction(caption(f"{path.name}   {path.parent}"), self._menu)
            action.setToolTip(tip(path))
            action.triggered.connect(partial(self.open, path))
            self._menu.addAction(action)
        if not self.projects.paths:
            self._menu.addAction("No recent projects").setEnabled(False)

    def _on_picture(self, picture: Picture) -> None:
        scene = self.context.scene
        if not picture.request.moving and scene.channel == "rgb" and scene.feed.image is not None:
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
