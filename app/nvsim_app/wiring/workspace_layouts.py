"""Workspaces: the panels around the 3D view for one kind of work.
In code, each is a `WorkspaceLayout`.

Panels that do not apply to the open file are closed, and open again when they apply. The window stores what the user
opens, closes, and moves, for each workspace, and separately for projects, graph files, and splat files. One command
shows a single view alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from PySide6.QtCore import QByteArray, QSettings, Qt
from PySide6.QtWidgets import QApplication, QDockWidget, QMenu, QTabBar, QToolButton, QWidget

from nvsim_app.actions import Action
from nvsim_app.look.boxes import hbox
from nvsim_app.look.notices import Notice
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import with_project
from nvsim_app.wiring.part import Part, WindowContext

OpenKind = Literal["nothing", "project", "graph", "splats"]
LAYOUT_VERSION = 6  # increased when docks or toolbars change, so that older stored layouts are ignored
_BARS = 100  # height of the menu, tools, and status bar, pixels
_SIDE = 380  # width of the column beside the main view, pixels
_MAIN = 0.65  # share of the rest for the main view
_AROUND = 0.55  # largest share of the columns around the center in the width of the window
_COLUMN = 288  # least width of these columns, pixels
_LOW = 440  # height of the room for views in pixels, up to which a main view takes all of it
_TOLD = 6000  # milliseconds of a message


@dataclass(frozen=True)
class WorkspaceLayout:
    """A workspace. The panels that it opens name it in `Dock.workspaces`.

    front    docks that are in front of the other tabs of their place
    heights  default heights of docks in pixels, if there is room
    main     dock that is wider than the center; "" if the center is the main view
    """

    id: str
    text: str
    tip: str
    shortcut: str
    front: tuple[str, ...]
    heights: Mapping[str, int] = field(default_factory=dict)
    main: str = ""


WORKSPACE_LAYOUTS = (
    WorkspaceLayout(
        "explore", "&Explore", "Explore: 3D view, map, layers, frames", "Alt+1",
        ("layers", "frames", "details"), {"map": 330, "details": 490, "layers": 270, "frames": 420},
    ),
    WorkspaceLayout(
        "train", "&Train", "Train: jobs, curves, results, submaps", "Alt+2",
        ("submaps", "frames", "details", "jobs"), {"jobs": 320, "map": 360, "details": 300},
    ),
    WorkspaceLayout(
        "edit", "Edit &graph", "Review and edit the graph: findings, thresholds, history, tables", "Alt+3",
        ("validation", "tables"), {"tables": 190}, main="map",
    ),
    WorkspaceLayout(
        "compare", "&Compare", "Compare two graphs, frames with renders, and results", "Alt+4",
        ("layers", "compare", "details", "results"), {"results": 230, "map": 360, "details": 380},
    ),
)  # fmt: skip
_BY_ID = {layout.id: layout for layout in WORKSPACE_LAYOUTS}
_FIRST: dict[OpenKind, str] = {"nothing": "explore", "project": "explore", "graph": "edit", "splats": "explore"}


def kind_of(document: Document) -> OpenKind:
    """The kind of the open file, which is known before the file is read."""
    if document.path is None:
        return "nothing"
    if document.contents.outline is not None:
        return "splats"
    if document.project is not None:
        return "project"
    return "graph" if document.graph is not None or document.path.suffix.lower() == ".json" else "splats"


class WorkspacePart(Part):
    """Switches, stores, and restores workspaces."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.current = WORKSPACE_LAYOUTS[0]
        self.kind: OpenKind = "nothing"
        self._wanted: set[str] = set()  # panels that open as soon as they apply
        self._asked: set[str] = set()  # panels that the user opened although they do not apply
        self._put: dict[str, bool] = {}  # panel -> whether it was open at the last check
        self._before: QByteArray | None = None  # the layout before one view was shown alone

    def restore(self, settings: QSettings) -> None:
        window, document = self.context.window, self.context.document
        self._first_layout = window.saveState(LAYOUT_VERSION)
        self._docks, self._needs = window.docks, {row.name: row.needs for row in window.rows}
        self._gather_in_menu()
        self._tabs = self._make_tabs()
        window.menuBar().setCornerWidget(self._tabs)
        document.projectLeft.connect(self._keep)
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        self.context.notices.added.connect(self._on_notice)
        self._begin()

    def store(self, settings: QSettings) -> None:
        self._keep()

    # Entering and keeping ---------------------------------------------------------------------------------------

    def enter(self, id: str) -> None:
        """Shows a workspace as the user left it. Raises KeyError if the id is unknown."""
        layout = _BY_ID[id]
        self._keep()
        self.current = layout
        self._remember()
        self._lay_out()

    def reset(self) -> None:
        """Restores the defaults of the current workspace."""
        self.show_all()
        for key in ("panels", "state"):
            self.context.settings.remove(self._key(key))
        self._lay_out()

    def _on_chosen(self, id: str, _: bool = True) -> None:
        """Enters a workspace, and gives the keys to its main view, so that they do not go into a text field."""
        self.enter(id)
        view = self._main_view()
        if view is not None:
            view.setFocus()

    def _main_view(self) -> QWidget | None:
        main = self.current.main
        if main and self._docks[main].isVisible():
            return self._docks[main].widget()
        return self.context.window.center.currentWidget()

    def _remember(self) -> None:
        self.context.settings.setValue(f"workspace/{self.kind}", self.current.id)
        self.context.window.actions_table[f"workspace_{self.current.id}"].setChecked(True)

    def _key(self, what: str) -> str:
        return f"workspaces/{self.current.id}/{self.kind}/{what}"

    def _keep(self) -> None:
        """Stores the current layout."""
        self.show_all()
        if self.kind == "nothing":
            return
        self._note()
        settings = self.context.settings
        settings.setValue(self._key("panels"), sorted(self._wanted))
        settings.setValue(self._key("state"), self.context.window.saveState(LAYOUT_VERSION))

    def _begin(self) -> None:
        """Selects the workspace for the open file."""
        self.kind = kind_of(self.context.document)
        stored = str(self.context.settings.value(f"workspace/{self.kind}", ""))
        self.current = _BY_ID[stored if stored in _BY_ID else _FIRST[self.kind]]
        self._remember()
        self._tabs.setVisible(self.kind != "nothing")
        self._lay_out()
        self.context.window.tools.setVisible(self.kind != "nothing")

    def _lay_out(self) -> None:
        window, settings = self.context.window, self.context.settings
        names, state = settings.value(self._key("panels")), settings.value(self._key("state"))
        names = [names] if isinstance(names, str) else names
        own = isinstance(names, list) and isinstance(state, QByteArray)
        size = window.size()
        self._asked.clear()
        self._wanted = {str(n) for n in names} & set(self._docks) if own else self._defaults()
        if self.kind == "nothing":
            self._wanted = set()
        window.setUpdatesEnabled(False)
        if not (own and self._restore_layout(state)):
            own = False
            self._restore_layout(self._first_layout)
        self._put = self._open_now()
        self.open_panels()
        layout = window.layout()
        if window.size() != size and layout is not None:  # the layout with closed panels needed more room
            layout.activate()
            window.resize(size)
        if not own:
            self._arrange()
        window.setUpdatesEnabled(True)

    def _defaults(self) -> set[str]:
        """The panels that the current workspace opens in a window of this height."""
        low = self.current.main and self.context.window.height() - _BARS <= _LOW
        below = {row.name for row in self.context.window.rows if row.area in ("left", "bottom")} if low else set()
        return self.panels(self.current.id) - below

    def panels(self, id: str) -> set[str]:
        """The panels that a workspace opens."""
        return {row.name for row in self.context.window.rows if id in row.workspaces}

    def _arrange(self) -> None:
        """Applies the default places, tabs, and sizes of this workspace."""
        window, docks = self.context.window, self._docks
        widths = {row.name: row.width for row in window.rows if row.width}
        narrow = min(1.0, _AROUND * window.width() / max(1, sum(widths.values())))
        widths = {name: max(_COLUMN, round(narrow * width)) for name, width in widths.items()}
        if self.current.main:
            widths = self._move_panels_beside(self.current.main)
        for name in self.current.front:
            docks[name].raise_()
        window.resizeDocks([docks[name] for name in widths], list(widths.values()), Qt.Orientation.Horizontal)
        room = window.height() - _BARS
        for area in ("left", "right", "bottom"):
            names = [row.name for row in window.rows if row.area == area]
            high = {n: h for n, h in self.current.heights.items() if n in names and not docks[n].isHidden()}
            share = min(1.0, room / max(1, sum(high.values())))
            window.resizeDocks(
                [docks[n] for n in high], [round(share * h) for h in high.values()], Qt.Orientation.Vertical
            )

    def _move_panels_beside(self, main: str) -> dict[str, int]:
        """Puts the other panels of the area of `main` into a column beside it, and those of the left area into the tabs
        at the bottom. Returns the widths of the columns."""
        window, docks = self.context.window, self._docks
        area = {row.name: row.area for row in window.rows}
        column = [name for name in docks if area[name] == area[main] and name != main]
        bottom = [name for name in docks if area[name] == "bottom"]
        hidden = {name: dock.isHidden() for name, dock in docks.items()}
        moved = [name for name in docks if area[name] == "left" and name in self.panels(self.current.id)]
        for name in (*column, *moved):
            window.removeDockWidget(docks[name])
        window.splitDockWidget(docks[main], docks[column[0]], Qt.Orientation.Horizontal)
        for name in column[1:]:
            window.tabifyDockWidget(docks[column[0]], docks[name])
        for name in moved:
            window.tabifyDockWidget(docks[bottom[0]], docks[name])
        for name in (*column, *moved):
            docks[name].setVisible(not hidden[name])
        window.setCorner(Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.BottomDockWidgetArea)
        side = next((name for name in column if not hidden[name]), column[0])
        return {main: round(_MAIN * (window.width() - _SIDE)), side: _SIDE}

    def _restore_layout(self, state: QByteArray) -> bool:
        """Restores a layout; returns whether `state` was valid. Qt creates new tab bars and would leave the old ones
        visible, so these are hidden first."""
        window = self.context.window
        for bar in window.children():  # `findChildren` would keep the Python objects of deleted tab bars
            if isinstance(bar, QTabBar):
                bar.hide()
        return window.restoreState(state, LAYOUT_VERSION)

    # Which panels apply -------------------------------------------------------------------------------------------

    def open_panels(self) -> None:
        """Opens the panels of this workspace that apply to the open file, and closes the others."""
        if self._before is not None:
            return  # done when all views are shown again
        self._note()
        document = self.context.document
        for name, dock in self._docks.items():
            says = document.contents.reading or name in self._asked or self._needs[name](document) is None
            wanted = name in self._wanted and says
            if wanted == dock.isHidden():
                dock.setVisible(wanted)
        self._put = self._open_now()

    def _note(self) -> None:
        """Records which panels the user opened or closed since the last check."""
        if self._before is not None:
            return
        for name, is_open in self._open_now().items():
            if is_open == self._put.get(name):
                continue
            if is_open:
                self._wanted.add(name)
                self._asked.add(name)
            else:
                self._wanted.discard(name)
                self._asked.discard(name)
        self._put = self._open_now()

    def _open_now(self) -> dict[str, bool]:
        return {name: not dock.isHidden() for name, dock in self._docks.items()}

    def _on_project(self) -> None:
        self._begin()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if not self.context.document.contents.reading:
            self.open_panels()

    # One view alone -----------------------------------------------------------------------------------------------

    @property
    def shows_one_view(self) -> bool:
        """Whether one view is shown alone."""
        return self._before is not None

    def maximise(self) -> None:
        """Shows only the panel with the keyboard focus, or else the center. If one is alone, shows all again."""
        if self.shows_one_view:
            self.show_all()
            return
        window = self.context.window
        self._note()
        chosen = self._with_keys()
        self._before = window.saveState(LAYOUT_VERSION)
        for dock in self._docks.values():
            if dock is not chosen and not dock.isFloating():
                dock.hide()
        if chosen is not None:
            window.center.hide()
        name = "The center view" if chosen is None else chosen.windowTitle()
        window.statusBar().showMessage(f"{name} is shown alone; F12 shows the others again.", _TOLD)

    def show_all(self) -> None:
        """Shows all views again, in the layout before one was shown alone."""
        if self._before is None:
            return
        window, before = self.context.window, self._before
        window.center.show()
        self._restore_layout(before)
        self._before = None
        self.open_panels()

    def _with_keys(self) -> QDockWidget | None:
        widget: QWidget | None = QApplication.focusWidget()
        while widget is not None:
            if isinstance(widget, QDockWidget) and widget in self._docks.values() and not widget.isFloating():
                return widget
            widget = widget.parentWidget()
        return None

    def _on_notice(self, notice: Notice) -> None:
        """Shows the center if an error occurs, because notices appear over it."""
        if notice.severity == "error" and self.shows_one_view and self.context.window.center.isHidden():
            self.show_all()

    # Menu and tabs ------------------------------------------------------------------------------------------------

    def _gather_in_menu(self) -> None:
        window = self.context.window
        actions = [window.actions_table[f"workspace_{a.id}"] for a in WORKSPACE_LAYOUTS]
        gathered = QMenu("&Workspace", window, toolTipsVisible=True)
        for menu in window.menuBar().findChildren(QMenu):
            if actions[0] in menu.actions():
                menu.insertMenu(actions[0], gathered)
                for action in actions:
                    menu.removeAction(action)
                    gathered.addAction(action)
                return

    def _make_tabs(self) -> QWidget:
        """The buttons of the workspaces at the end of the menu bar."""
        holder = QWidget(self.context.window)
        row = hbox(on=holder, margins=(0, 0, 8, 0), spacing=0)
        for layout in WORKSPACE_LAYOUTS:
            action = self.context.window.actions_table[f"workspace_{layout.id}"]
            action.setIconText(layout.text.replace("&", ""))
            button = QToolButton(holder, autoRaise=True, toolButtonStyle=Qt.ToolButtonStyle.ToolButtonTextOnly)
            button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
            button.setDefaultAction(action)
            row.addWidget(button)
        return holder

    ACTIONS = (
        *(
            Action("&View", 8, f"workspace_{a.id}", f"{a.text} workspace", a.tip,
                   lambda self, id=a.id: self._on_chosen(id), a.shortcut, with_project, check="off", group="workspace")
            for a in WORKSPACE_LAYOUTS
        ),
        Action("&View", 9, "maximise", "&Maximize the view",
               "Show only the focused panel, or else the center; again: all", maximise, "F12", with_project),
        Action("&Window", 0, "reset_layout", "&Reset workspace", "Restore the default panels of this workspace", reset,
               enabled=with_project, icon="layout"),
    )  # fmt: skip
