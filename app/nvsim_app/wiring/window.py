"""The main window: combines the 3D view and the parts around one document. The parts implement the commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from PySide6.QtCore import QByteArray, QChildEvent, QEvent, QSettings, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeyEvent, QKeySequence, QWindow
from PySide6.QtWidgets import (
    QApplication,
    QDialog,
    QDockWidget,
    QMainWindow,
    QSizePolicy,
    QStackedWidget,
    QTabBar,
    QTabWidget,
    QToolBar,
    QToolButton,
    QWidget,
)

from nvsim_app.actions import ActionTable
from nvsim_app.drawing.painter import LogRemark
from nvsim_app.drawing.render_child import RenderError
from nvsim_app.jobs.queue import JobQueue
from nvsim_app.look.icons import icon, save_image
from nvsim_app.look.labels import Label
from nvsim_app.look.notices import NoticeArea, Notices
from nvsim_app.look.plain_text import plain, title
from nvsim_app.look.widgets import LEAST, Scrolling, StatusLine, align_to_grid
from nvsim_app.modes.controller import ModeController
from nvsim_app.panels.preferences import Preferences
from nvsim_app.panels.stages import EmptyState
from nvsim_app.panels.start_page import StartPage
from nvsim_app.state.document import Document
from nvsim_app.state.opened_files import SplatFile
from nvsim_app.views.scene_view import SceneView
from nvsim_app.wiring import PARTS
from nvsim_app.wiring.part import AnyPart, Dock, WindowContext

_REASON = 6000  # milliseconds that the status bar shows why a key had no effect
_SIZE = QSize(1480, 920)  # of the first window, if the screen has room
_RIM = QSize(8, 40)  # pixels that the frame of a window manager may take
_AREAS = {
    "bottom": Qt.DockWidgetArea.BottomDockWidgetArea,
    "left": Qt.DockWidgetArea.LeftDockWidgetArea,
    "right": Qt.DockWidgetArea.RightDockWidgetArea,
}


class MainWindow(QMainWindow):
    """The main window of the application.

    projectChosen(Path): open another project or file. turnWanted(): use the next axis of the splat file as up.
    refreshWanted(): read the project again. closeWanted(): close the project, not the window.
    """

    projectChosen = Signal(object)
    turnWanted = Signal()
    refreshWanted = Signal()
    closeWanted = Signal()

    def __init__(self, document: Document, settings: QSettings, notices: Notices) -> None:
        super().__init__()
        self.setObjectName("mainWindow")
        self.document, self.settings, self.notices = document, settings, notices
        self._stored = False
        self._front: QDialog | None = None
        app = QApplication.instance()
        assert isinstance(app, QApplication)
        app.focusWindowChanged.connect(self._on_focus)
        self.scene = SceneView(document)
        self.empty = EmptyState()
        self.start = StartPage()
        self.center = _Pages(self)
        self.center.addWidget(self.scene)
        self.center.addWidget(self.empty)
        self.center.addWidget(self.start)
        self.setCentralWidget(self.center)
        self.notice_area = NoticeArea(notices, self.center)
        self.center.currentChanged.connect(self.notice_area.raise_)  # a page that comes to the front would cover it
        self.jobs = document.jobs = JobQueue(self)
        self.modes = ModeController(document, self)
        document.projectLeft.connect(self._on_left)
        document.projectChanged.connect(self._on_project)
        self._titles = QTimer(self, singleShot=True, interval=0)
        self._titles.timeout.connect(self._update_dock_titles)
        self.preferences = Preferences(settings, self)
        context = WindowContext(document, settings, notices, self.scene, self.jobs, self.modes, self, self.preferences)
        self.parts = [part(context) for part in PARTS]
        docks = [dock for part in self.parts for dock in part.docks()]
        self.panels = {dock.name: dock.widget for dock in docks}
        self.docks: Mapping[str, QDockWidget] = {dock.name: self._dock(dock) for dock in docks}
        self.rows: Sequence[Dock] = docks
        self.actions_table = ActionTable(document, [(row, part) for part in self.parts for row in part.actions()], self)
        self._build_bars()
        self._arrange()
        self._connect()
        self.resize(_SIZE.boundedTo(self.screen().availableSize() - _RIM))
        self._restore()
        # If a hidden window is laid out again, Qt leaves the old tab bars visible.
        for bar in self.findChildren(QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly):
            bar.hide()
        align_to_grid(self)
        self._apply_palette()
        self._on_contents(frozenset({"capture"}))

    # Making ----------------------------------------------------------------------------------------------------

    def _dock(self, row: Dock) -> QDockWidget:
        dock = QDockWidget(row.title, self)
        dock.setObjectName(f"dock_{row.name}")
        high = row.widget.minimumSizeHint().height() > LEAST
        dock.setWidget(Scrolling(row.widget) if high else row.widget)
        if not row.widget.accessibleName():
            row.widget.setAccessibleName(row.title)
        dock.setMinimumWidth(200)  # so that a layout from a smaller screen does not shrink it to nothing
        for changed in (dock.topLevelChanged, dock.visibilityChanged):
            changed.connect(self._titles.start)
        return dock

    def _update_dock_titles(self) -> None:
        """Hides the titles of docks that share a place, because their tabs show the titles."""
        for dock in self.docks.values():
            self._title(dock)

    def _title(self, dock: QDockWidget) -> None:
        named = not dock.isFloating() and any(not other.isHidden() for other in self.tabifiedDockWidgets(dock))
        if named and dock.titleBarWidget() is None:
            dock.setTitleBarWidget(QWidget(dock))
        elif not named and dock.titleBarWidget() is not None:
            dock.titleBarWidget().deleteLater()
            dock.setTitleBarWidget(None)  # type: ignore[arg-type]

    def _build_bars(self) -> None:
        menus = self.actions_table.fill_menus(self.menuBar())
        window_menu = menus["&Window"]
        window_menu.addSeparator()
        for dock in self.docks.values():
            window_menu.addAction(dock.toggleViewAction())
            dock.toggleViewAction().triggered.connect(dock.raise_)  # an opened dock is in front of its tabs
        bar = QToolBar("Tools", self, movable=False)
        bar.setObjectName("toolbar")
        bar.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
        tools = QToolBar(bar)  # only a tool bar in a widget has a menu of the buttons that do not fit
        tools.setObjectName("tools")
        tools.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        tools.setContentsMargins(0, 0, 0, 0)
        self.actions_table.fill_toolbar(tools)
        bar.addWidget(tools)
        self.addToolBar(bar)
        more = tools.findChild(QToolButton, "qt_toolbar_ext_button")
        assert isinstance(more, QToolButton)
        more.setToolTip("More commands")
        more.setAccessibleName("More commands")
        self._more_tools, self.tools = more, bar
        self.setStatusBar(StatusLine(self))
        self._summary = Label(self, quiet=True)
        self.statusBar().addPermanentWidget(self._summary)

    def _arrange(self) -> None:
        docks = self.docks
        self.setDockNestingEnabled(True)
        self.setCorner(Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea)
        self.setTabPosition(Qt.DockWidgetArea.AllDockWidgetAreas, QTabWidget.TabPosition.North)
        above: dict[str, QDockWidget] = {}  # area -> its lowest dock
        for row in (r for r in self.rows if not r.tab):
            if row.area in above:
                self.splitDockWidget(above[row.area], docks[row.name], Qt.Orientation.Vertical)
            else:
                self.addDockWidget(_AREAS[row.area], docks[row.name])
            above[row.area] = docks[row.name]
        for row in (r for r in self.rows if r.tab):
            self.tabifyDockWidget(docks[row.tab], docks[row.name])
        for row in (r for r in self.rows if not r.tab):
            docks[row.name].raise_()
        wide = [row for row in self.rows if row.width]
        self.resizeDocks([docks[r.name] for r in wide], [r.width for r in wide], Qt.Orientation.Horizontal)
        for area in reversed(_AREAS):
            high = [row for row in self.rows if row.height and row.area == area]
            self.resizeDocks([docks[r.name] for r in high], [r.height for r in high], Qt.Orientation.Vertical)

    def _connect(self) -> None:
        self.scene.troubled.connect(self._on_trouble)
        self.scene.remarked.connect(self._on_remark)
        self.document.contentsChanged.connect(self._on_contents)
        self.document.graphChanged.connect(self._summarise)
        self.document.selectionChanged.connect(self._summarise)
        self.jobs.changed.connect(self.actions_table.refresh)

    # Following the document ------------------------------------------------------------------------------------

    def _on_left(self) -> None:
        """Removes messages about the file that is left."""
        self.notice_area.clear()
        self.statusBar().clearMessage()

    def _on_project(self) -> None:
        self.jobs.set_project(self.document.project)

    def _on_contents(self, parts: frozenset[str]) -> None:
        contents = self.document.contents
        missing = contents.missing
        nothing = len(self.document.extent) == 0
        if nothing or self.center.currentWidget() in (self.empty, self.start):
            bare = self.start if contents.path is None else self.empty
            self.center.setCurrentWidget(bare if nothing else self.scene)
        if missing:
            self.empty.show_message(missing, contents.missing_verb)
        self.show_title()
        self._summarise()

    def show_title(self) -> None:
        """Shows the name of the open file in the title, and whether it is read-only."""
        path = self.document.contents.path
        only = " [read-only]" if self.document.editing.locked else ""
        # Qt replaces [*] with * while there are unsaved edits.
        self.setWindowTitle(f"{title(path.name)}[*]{only} – NVSim" if path is not None else "NVSim")

    def _summarise(self, _: object = None) -> None:
        contents, graph = self.document.contents, self.document.graph
        capture, chosen = contents.capture, self.document.editing.selection
        parts = [(len(chosen.viewpoints), "viewpoint"), (len(chosen.edges), "edge")]
        selected = " and ".join(_count(number, thing) for number, thing in parts if number)
        words = [
            f"{selected} selected" if selected else "",
            _count(len(capture.frames), "frame") if capture and capture.has_images else "",
            _count(len(contents.submaps), "submap") if contents.submaps else "",
            f"{_count(len(graph.viewpoints), 'viewpoint')}, {_count(len(graph.edges), 'edge')}" if graph else "",
        ]
        self._summary.setText("   ".join(w for w in words if w) or self._summary_of_splats())

    def _summary_of_splats(self) -> str:
        stamp = self.document.contents.scene_stamp
        return f"splat file, {stamp.up} is up" if isinstance(stamp, SplatFile) else ""

    def _on_trouble(self, trouble: RenderError) -> None:
        self.notices.add("error" if trouble.fatal else "warning", trouble.message, trouble.trace)

    def _on_remark(self, remark: LogRemark) -> None:
        self.notices.add("warning" if remark.warning else "log", remark.message, remark.trace)

    # For the parts ---------------------------------------------------------------------------------------------------

    def part(self, kind: type[AnyPart]) -> AnyPart:
        """The part of a class. Raises LookupError if it does not exist yet."""
        for part in self.parts:
            if isinstance(part, kind):
                return part
        raise LookupError(f"the window has no {kind.__name__}")

    def show_page(self, page: QWidget | None) -> None:
        """Shows a page that a part added to the center; None returns to the 3D view."""
        self.center.setCurrentWidget(page if page is not None else self.scene)

    def save_picture(self, path: Path, widget: QWidget) -> bool:
        """Saves the image of `widget`. An error becomes a notice. Returns whether it was saved."""
        with self.notices.reporting(about="save"):
            save_image(widget.grab(), path)
            self.notices.info(f"Saved {path}.", about="save")
            return True
        return False

    def close_dialog(self) -> bool:
        """Closes the dialog in front, also if it does not have the keyboard focus. Returns whether there was one."""
        dialogs = [d for d in self.findChildren(QDialog) if d.isVisible()]
        if not dialogs:
            return False
        (self._front if self._front is not None and self._front in dialogs else dialogs[-1]).reject()
        return True

    def _on_focus(self, focused: QWindow | None) -> None:
        """Remembers the dialog that had the keyboard focus last, which is in front of the others."""
        for dialog in self.findChildren(QDialog):
            if focused is not None and dialog.windowHandle() is focused:
                self._front = dialog

    @property
    def dock_titles(self) -> dict[str, str]:
        """Name -> title of every panel."""
        return {row.name: row.title for row in self.rows}

    def show_dock(self, name: str) -> None:
        """Brings a panel to the front. Raises KeyError if the name is unknown."""
        self.docks[name].show()
        self.docks[name].raise_()

    def front_dock(self, name: str) -> None:
        """Brings a panel to the front of its tabs, unless it is closed. Raises KeyError if the name is unknown."""
        if not self.docks[name].isHidden():
            self.docks[name].raise_()

    # Look and layout -------------------------------------------------------------------------------------------

    def _apply_palette(self) -> None:
        self.actions_table.apply_palette(self.palette())
        self._more_tools.setIcon(icon("more", self.palette()))
        self.empty.apply_palette()

    def _restore(self) -> None:
        geometry = self.settings.value("geometry")
        if isinstance(geometry, QByteArray):
            self.restoreGeometry(geometry)
        for part in self.parts:
            part.restore(self.settings)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Closes a dialog on Esc, and shows why the command of another unhandled key is unavailable."""
        if event.key() == Qt.Key.Key_Escape and self.close_dialog():
            return
        reason = self.actions_table.why_not(QKeySequence(event.keyCombination()))
        if reason:
            self.statusBar().showMessage(plain(reason), _REASON)
        super().keyPressEvent(event)

    def childEvent(self, event: QChildEvent) -> None:
        """Gives the tabs of docks the room of their titles. Qt would shorten the titles to a few letters before it
        shows scroll buttons."""
        if event.type() == QEvent.Type.ChildPolished and isinstance(bar := event.child(), QTabBar):
            bar.setElideMode(Qt.TextElideMode.ElideNone)
        super().childEvent(event)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "actions_table"):
            self._apply_palette()
        super().changeEvent(event)

    def closeEvent(self, event: QCloseEvent) -> None:
        if self._stored:
            # The window is already closed, and objects that the parts use may be deleted.
            super().closeEvent(event)
            return
        self._stored = True
        self.settings.setValue("geometry", self.saveGeometry())
        for part in self.parts:
            part.store(self.settings)
        self.jobs.stop()
        self.scene.release()
        super().closeEvent(event)


class _Pages(QStackedWidget):
    """The pages in the center. Only the page that is shown limits the size."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.currentChanged.connect(self._on_page)

    def _on_page(self) -> None:
        self.updateGeometry()

    def minimumSizeHint(self) -> QSize:
        page = self.currentWidget()
        return super().minimumSizeHint() if page is None else page.minimumSizeHint().expandedTo(page.minimumSize())


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"
