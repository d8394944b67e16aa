"""Every command of the window in one table, from which menus, toolbar and shortcuts are built.

A command that cannot run now says why: its reason stands in the tool tip and in the status bar.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QObject
from PySide6.QtGui import QAction, QActionGroup, QKeySequence, QPalette
from PySide6.QtWidgets import QMenu, QMenuBar, QToolBar

from app.document import Document
from app.icons import icon
from app.renderer_choice import AUTOMATIC, CPU, OPENGL

Reason = str | None  # why a command cannot run, None when it can


UNDECIDED = "a splat file is open, which has no walk and no graph"


def always(document: Document) -> Reason:
    return None


def with_project(document: Document) -> Reason:
    return None if document.path else "no project is open"


def with_positions(document: Document) -> Reason:
    return None if len(document.extent) else "the project has neither a trajectory nor a graph yet"


def with_scene(document: Document) -> Reason:
    return None if document.contents.scene_stamp is not None else "no submap is trained yet"


def with_graph(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return None if document.contents.graph is not None else "no navigation graph is built yet"


def with_trajectory(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return None if len(document.trajectory.positions) else "the project has no capture yet"


def with_splat_file(document: Document) -> Reason:
    return None if document.contents.outline is not None else "only a splat file may lie on its side"


def with_selection(document: Document) -> Reason:
    return None if document.selection else "nothing is selected"


@dataclass(frozen=True)
class Action:
    """One command.

    id         also the key of its handler
    menu       the menu it stands in; a new `section` begins with a separator
    check      "" for a plain command, "on" or "off" for a switch and its first state
    group      switches of one group exclude each other
    toolbar    whether it has a button
    """

    id: str
    text: str
    tip: str
    menu: str
    section: int = 0
    shortcut: str = ""
    icon: str = ""
    check: str = ""
    group: str = ""
    toolbar: bool = False
    enabled: Callable[[Document], Reason] = always


ACTIONS: tuple[Action, ...] = (
    Action("open", "&Open project…", "Open another project folder", "&File", shortcut="Ctrl+O", icon="open",
           toolbar=True),
    Action("open_splats", "Open s&plats…", "Open a splat file of any program: PLY, compressed PLY, SPZ, SOG, .splat",
           "&File", shortcut="Ctrl+Shift+O"),
    Action("refresh", "&Refresh", "Read the project again now", "&File", shortcut="F5", icon="refresh",
           enabled=with_project),
    Action("screenshot", "&Save picture of the view…", "Save what the 3D view shows as a PNG file", "&File", 1,
           "Ctrl+Shift+S", "camera"),
    Action("quit", "&Quit", "Close the window; running jobs go on", "&File", 2, "Ctrl+Q", "quit"),
    Action("home", "&Home", "Back to where the walk began", "&Camera", shortcut="H", icon="home", toolbar=True,
           enabled=with_positions),
    Action("overview", "Over&view", "The whole building from a raised corner", "&Camera", shortcut="O", icon="overview",
           toolbar=True, enabled=with_positions),
    Action("above", "From &above", "Straight down, north up", "&Camera", shortcut="T", icon="above", toolbar=True,
           enabled=with_positions),
    Action("turn_up", "Turn &upright", "Take the next axis of the splat file for up", "&Camera", shortcut="U",
           enabled=with_splat_file),
    Action("focus", "&Focus on selection", "Bring what is selected before the camera", "&Camera", shortcut="F",
           icon="focus", toolbar=True, enabled=with_selection),
    Action("previous_frame", "&Previous frame", "Stand where the frame before was taken", "&Camera", 1, "[", "previous",
           enabled=with_trajectory),
    Action("next_frame", "&Next frame", "Stand where the next frame was taken", "&Camera", 1, "]", "next",
           enabled=with_trajectory),
    Action("rgb", "&Colour", "Show colours", "&View", shortcut="1", icon="rgb", check="on", group="channel",
           toolbar=True, enabled=with_scene),
    Action("alpha", "&Alpha", "Show where something stands: white is opaque, black is floor or emptiness", "&View",
           shortcut="2", icon="alpha", check="off", group="channel", toolbar=True, enabled=with_scene),
    Action("normal", "&Normals", "Show which way surfaces face", "&View", shortcut="3", icon="normal", check="off",
           group="channel", toolbar=True, enabled=with_scene),
    Action("depth", "&Depth", "Show distance: near is bright", "&View", shortcut="4", icon="depth", check="off",
           group="channel", toolbar=True, enabled=with_scene),
    Action("show_graph", "&Graph", "Draw the navigation graph over the view", "&View", 1, "G", "graph", "on",
           toolbar=True, enabled=with_graph),
    Action("show_trajectory", "&Trajectory", "Draw the walk over the view, in the colours of its submaps", "&View", 1,
           "J", "trajectory", "on", toolbar=True, enabled=with_trajectory),
    Action("show_labels", "&Labels", "Name the viewpoints that are near", "&View", 1, "L", "labels", "on",
           toolbar=True, enabled=with_graph),
    Action(f"renderer_{AUTOMATIC}", "Renderer: a&utomatic", "Draw colours with whichever is faster here: both are "
           "timed", "&View", 2, check="on", group="renderer", enabled=with_scene),
    Action(f"renderer_{CPU}", "Renderer: &CPU", "Always draw with the processor", "&View", 2, check="off",
           group="renderer", enabled=with_scene),
    Action(f"renderer_{OPENGL}", "Renderer: &OpenGL", "Draw colours with the graphics card; the other views stay with "
           "the processor", "&View", 2, check="off", group="renderer", enabled=with_scene),
    Action("dark", "Dar&k theme", "Switch between dark and light", "&Window", shortcut="Ctrl+T", icon="theme",
           check="on"),
    Action("fullscreen", "F&ull screen", "Use the whole screen", "&Window", shortcut="F11", icon="fullscreen",
           check="off"),
    Action("reset_layout", "&Reset layout", "Put all panels back where they were at first", "&Window", icon="layout"),
    Action("help", "&Keys and mouse", "How to move around and what the keys do", "&Help", shortcut="F1", icon="help"),
)  # fmt: skip


class ActionTable(QObject):
    """The QActions of the table, kept enabled or disabled as the document changes."""

    def __init__(self, document: Document, handlers: dict[str, Callable[..., object]], parent: QObject) -> None:
        """Raises KeyError when an action has no handler."""
        super().__init__(parent)
        self._document = document
        self.actions: dict[str, QAction] = {}
        groups: dict[str, QActionGroup] = {}
        for entry in ACTIONS:
            action = QAction(entry.text, self)
            action.setObjectName(entry.id)
            if entry.shortcut:
                action.setShortcut(QKeySequence(entry.shortcut))
            if entry.check:
                action.setCheckable(True)
                action.setChecked(entry.check == "on")
            if entry.group:
                if entry.group not in groups:
                    groups[entry.group] = QActionGroup(self)
                groups[entry.group].addAction(action)
            (action.toggled if entry.check and not entry.group else action.triggered).connect(handlers[entry.id])
            self.actions[entry.id] = action
        document.contentsChanged.connect(self.refresh)
        document.selectionChanged.connect(self.refresh)
        self.refresh()

    def __getitem__(self, id: str) -> QAction:
        return self.actions[id]

    def refresh(self) -> None:
        """Asks every action whether it can run."""
        for entry in ACTIONS:
            action, reason = self.actions[entry.id], entry.enabled(self._document)
            action.setEnabled(reason is None)
            shortcut = f" ({entry.shortcut})" if entry.shortcut else ""
            tip = f"{entry.tip}{shortcut}" if reason is None else f"{entry.tip}{shortcut}\nNot now: {reason}."
            action.setToolTip(tip)
            action.setStatusTip(entry.tip if reason is None else f"{entry.tip}. Not now: {reason}.")

    def dress(self, palette: QPalette) -> None:
        """Draws the icons in the colours of `palette`."""
        for entry in ACTIONS:
            if entry.icon:
                self.actions[entry.id].setIcon(icon(entry.icon, palette))

    def fill_menus(self, bar: QMenuBar) -> dict[str, QMenu]:
        """Makes the menus; returns them by title."""
        menus: dict[str, QMenu] = {}
        section: dict[str, int] = {}
        for entry in ACTIONS:
            if entry.menu not in menus:
                menu = bar.addMenu(entry.menu)
                menu.setToolTipsVisible(True)
                menus[entry.menu], section[entry.menu] = menu, entry.section
            if entry.section != section[entry.menu]:
                menus[entry.menu].addSeparator()
                section[entry.menu] = entry.section
            menus[entry.menu].addAction(self.actions[entry.id])
        return menus

    def fill_toolbar(self, bar: QToolBar) -> None:
        last: tuple[str, int] | None = None
        for entry in ACTIONS:
            if not entry.toolbar:
                continue
            if last is not None and last != (entry.menu, entry.section):
                bar.addSeparator()
            last = (entry.menu, entry.section)
            bar.addAction(self.actions[entry.id])
