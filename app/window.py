"""The main window: puts the views and panels together and ties them to one document."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from PySide6.QtCore import QByteArray, QEvent, QSettings, Qt, Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import (
    QApplication,
    QDockWidget,
    QFileDialog,
    QLabel,
    QMainWindow,
    QStackedWidget,
    QTabWidget,
    QToolBar,
    QWidget,
)

from app import theme
from app.actions import ActionTable
from app.document import Document
from app.map_view import MapView
from app.notices import NoticeArea, Notices
from app.painter import Remark
from app.panels.details import DetailsPanel
from app.panels.empty import EmptyState
from app.panels.frames import FramePanel
from app.panels.help import HelpWindow
from app.panels.jobs import JobPanel
from app.panels.log import LogPanel
from app.panels.submaps import SubmapPanel
from app.render_child import RenderSource, Trouble
from app.renderer_choice import AUTOMATIC, PREFERENCES
from app.scene_view import SceneView
from app.splat_file import SplatFile
from app.tones import CHANNELS
from nvsim.splats.formats.choice import READABLE

LAYOUT_VERSION = 1  # raised when docks or toolbars change, so that an old stored layout is not forced on them


class MainWindow(QMainWindow):
    """projectChosen(Path): the person picked another project or a splat file; turnWanted(): the next axis for up;
    refreshWanted()."""

    projectChosen = Signal(object)
    turnWanted = Signal()
    refreshWanted = Signal()

    def __init__(self, document: Document, settings: QSettings, notices: Notices) -> None:
        super().__init__()
        self.setObjectName("mainWindow")
        self.document, self.settings, self.notices = document, settings, notices
        self.scene = SceneView(document)
        self.empty = EmptyState()
        self.centre = QStackedWidget(self)
        self.centre.addWidget(self.scene)
        self.centre.addWidget(self.empty)
        self.setCentralWidget(self.centre)
        self.map = MapView(document)
        self.submaps = SubmapPanel(document)
        self.frames = FramePanel(document)
        self.details = DetailsPanel(document)
        self.jobs = JobPanel(document)
        self.log = LogPanel(notices)
        self.notice_area = NoticeArea(notices, self.centre)
        self._docks = {
            name: self._dock(name, title, widget)
            for name, title, widget in (
                ("submaps", "Submaps", self.submaps),
                ("frames", "Frames", self.frames),
                ("map", "Map", self.map),
                ("details", "Details", self.details),
                ("jobs", "Jobs", self.jobs),
                ("log", "Log", self.log),
            )
        }
        self.actions_table = ActionTable(document, self._handlers(), self)
        self._build_bars()
        self._arrange()
        self._default_layout = self.saveState(LAYOUT_VERSION)
        self._connect()
        self.resize(1480, 920)
        self._restore()
        self._dress()
        self._on_contents(frozenset({"capture"}))

    # Making ----------------------------------------------------------------------------------------------------

    def _dock(self, name: str, title: str, widget: QWidget) -> QDockWidget:
        dock = QDockWidget(title, self)
        dock.setObjectName(f"dock_{name}")
        dock.setWidget(widget)
        dock.setMinimumWidth(200)  # a layout of a smaller screen must not squeeze it to nothing
        return dock

    def _build_bars(self) -> None:
        menus = self.actions_table.fill_menus(self.menuBar())
        window_menu = menus["&Window"]
        window_menu.addSeparator()
        for dock in self._docks.values():
            window_menu.addAction(dock.toggleViewAction())
        bar = QToolBar("Tools", self)
        bar.setObjectName("toolbar")
        bar.setMovable(False)
        bar.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
        self.actions_table.fill_toolbar(bar)
        self.addToolBar(bar)
        self._summary = QLabel(self)
        self._summary.setForegroundRole(self._summary.palette().ColorRole.PlaceholderText)
        self.statusBar().addPermanentWidget(self._summary)

    def _arrange(self) -> None:
        area, docks = Qt.DockWidgetArea, self._docks
        self.setDockNestingEnabled(True)
        self.setCorner(Qt.Corner.BottomRightCorner, area.RightDockWidgetArea)
        self.setTabPosition(area.AllDockWidgetAreas, QTabWidget.TabPosition.North)
        for dock in docks.values():
            dock.setFloating(False)
            dock.show()
        self.addDockWidget(area.LeftDockWidgetArea, docks["submaps"])
        self.splitDockWidget(docks["submaps"], docks["frames"], Qt.Orientation.Vertical)
        self.addDockWidget(area.RightDockWidgetArea, docks["map"])
        self.splitDockWidget(docks["map"], docks["details"], Qt.Orientation.Vertical)
        self.addDockWidget(area.BottomDockWidgetArea, docks["jobs"])
        self.tabifyDockWidget(docks["jobs"], docks["log"])
        for name in ("jobs", "log"):
            docks[name].setTitleBarWidget(QWidget(docks[name]))  # their tabs name them already
        docks["jobs"].raise_()
        self.resizeDocks([docks["submaps"], docks["map"]], [330, 380], Qt.Orientation.Horizontal)
        self.resizeDocks([docks["map"], docks["details"]], [400, 420], Qt.Orientation.Vertical)
        self.resizeDocks([docks["jobs"]], [150], Qt.Orientation.Vertical)

    def _connect(self) -> None:
        self.scene.poseChanged.connect(self.map.show_pose)
        self.scene.troubled.connect(self._on_trouble)
        self.scene.remarked.connect(self._on_remark)
        self.map.cameraDragged.connect(self._drag_camera)
        self.map.cameraPlaced.connect(self._place_camera)
        self.frames.opened.connect(self._open_frame)
        self.submaps.table.doubleClicked.connect(lambda _: self.scene.focus_on_selection())
        self.document.contentsChanged.connect(self._on_contents)

    def _handlers(self) -> dict[str, Callable[..., object]]:
        scene = self.scene
        handlers: dict[str, Callable[..., object]] = {
            "open": self._choose_project,
            "open_splats": self._choose_splats,
            "turn_up": self.turnWanted.emit,
            "refresh": self.refreshWanted.emit,
            "screenshot": self._save_picture,
            "quit": self.close,
            "home": scene.home,
            "overview": scene.look_over,
            "above": scene.look_from_above,
            "focus": scene.focus_on_selection,
            "previous_frame": lambda: self._step_frame(-1),
            "next_frame": lambda: self._step_frame(1),
            "show_graph": lambda on: self._show_layer("graph", on),
            "show_trajectory": lambda on: self._show_layer("trajectory", on),
            "show_labels": lambda on: self._show_layer("labels", on),
            "dark": self._set_dark,
            "fullscreen": lambda on: self.showFullScreen() if on else self.showNormal(),
            "reset_layout": lambda: self.restoreState(self._default_layout, LAYOUT_VERSION),
            "help": lambda: HelpWindow("keys", self).show(),
        }
        for channel in CHANNELS:
            handlers[channel] = lambda _=False, c=channel: scene.set_channel(c)
        for renderer in PREFERENCES:
            handlers[f"renderer_{renderer}"] = lambda _=False, r=renderer: self._set_renderer(r)
        return handlers

    # Following the document ------------------------------------------------------------------------------------

    def show_source(self, source: RenderSource | None) -> None:
        """Draws this reconstruction in the centre."""
        self.scene.show_source(source)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts == {"jobs"}:
            return
        contents = self.document.contents
        missing = contents.missing
        nothing = len(self.document.extent) == 0
        self.centre.setCurrentWidget(self.empty if nothing else self.scene)
        if missing is not None:
            self.empty.say(*missing)
        self.scene.hint = f"{missing[0]}   {missing[1]}" if missing is not None and not nothing else ""
        name = contents.path.name if contents.path else ""
        self.setWindowTitle(f"{name} – NVSim" if name else "NVSim")
        graph, capture = contents.graph, contents.capture
        words = [
            f"{len(capture.frames):,} frames" if capture else "",
            f"{len(contents.submaps)} submaps" if contents.submaps else "",
            f"{len(graph.viewpoints):,} viewpoints, {len(graph.edges):,} edges" if graph else "",
        ]
        self._summary.setText("   ".join(w for w in words if w) or self._summary_of_splats())

    def _summary_of_splats(self) -> str:
        stamp = self.document.contents.scene_stamp
        return f"splat file, {stamp.up} is up" if isinstance(stamp, SplatFile) else ""

    def _on_trouble(self, trouble: Trouble) -> None:
        self.notices.add("error" if trouble.fatal else "warning", trouble.message, trouble.trace)

    def _on_remark(self, remark: Remark) -> None:
        self.notices.add("warning" if remark.warning else "log", remark.message, remark.trace)

    # Commands --------------------------------------------------------------------------------------------------

    def _choose_project(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, "Open a project", str(self.document.path or Path.home()))
        if folder:
            self.projectChosen.emit(Path(folder))

    def _choose_splats(self) -> None:
        pattern = " ".join(f"*{suffix}" for suffix in READABLE)
        start = str(self.document.path or Path.home())
        name, _ = QFileDialog.getOpenFileName(self, "Open a splat file", start, f"Splats ({pattern})")
        if name:
            self.projectChosen.emit(Path(name))

    def _save_picture(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save picture", "view.png", "PNG (*.png)")
        if name:
            self.save_picture(Path(name), self.scene)

    def save_picture(self, path: Path, widget: QWidget) -> bool:
        """What `widget` shows, as a file. A failure becomes a notice."""
        if widget.grab().save(str(path)):
            self.notices.info(f"Saved {path}.")
            return True
        self.notices.error(f"Cannot write {path}; choose a writable folder and a name ending in .png.")
        return False

    def _show_layer(self, layer: str, on: bool) -> None:
        setattr(self.scene.overlays.layers, layer, on)
        self.scene.update()

    def _step_frame(self, step: int) -> None:
        count = len(self.document.trajectory.positions)
        current = self.document.selection.frame
        frame = 0 if current is None else (current + step) % count
        self._open_frame(frame)

    def _open_frame(self, frame: int) -> None:
        self.document.select(frame=frame)
        self.scene.snap_to_frame(frame)

    def _drag_camera(self, x: float, y: float) -> None:
        pose = self.scene.pose
        self.scene.navigation.set_pose(replace(pose, position=(x, y, pose.position[2])))

    def _place_camera(self, x: float, y: float) -> None:
        extent = self.document.extent
        if len(extent):
            nearest = extent[np.argmin(np.hypot(extent[:, 0] - x, extent[:, 1] - y))]
            self.scene.go_to_position(np.array([x, y, nearest[2]]))

    def _set_renderer(self, renderer: str) -> None:
        self.settings.setValue("renderer", renderer)
        self.scene.set_renderer(renderer)

    # Look and layout -------------------------------------------------------------------------------------------

    def _set_dark(self, dark: bool) -> None:
        name = "dark" if dark else "light"
        self.settings.setValue("theme", name)
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        theme.apply(app, name)

    def _dress(self) -> None:
        self.actions_table.dress(self.palette())
        self.empty.dress()

    def _restore(self) -> None:
        geometry, state = self.settings.value("geometry"), self.settings.value("state")
        if isinstance(geometry, QByteArray):
            self.restoreGeometry(geometry)
        if isinstance(state, QByteArray):
            self.restoreState(state, LAYOUT_VERSION)
        renderer = self.settings.value("renderer", AUTOMATIC)
        if renderer in PREFERENCES:
            self.scene.renderer = str(renderer)
            self.actions_table[f"renderer_{renderer}"].setChecked(True)
        dark = self.actions_table["dark"]
        dark.blockSignals(True)
        dark.setChecked(theme.is_dark(self.palette()))
        dark.blockSignals(False)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "actions_table"):
            self._dress()
        super().changeEvent(event)

    def closeEvent(self, event: QCloseEvent) -> None:
        self.settings.setValue("geometry", self.saveGeometry())
        self.settings.setValue("state", self.saveState(LAYOUT_VERSION))
        self.scene.release()
        super().closeEvent(event)
