"""What the mouse does in the views: the modes of editing, and the context menu."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QMenu

from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import Edge, Viewpoint
from nvsim.plain_text import count_text
from nvsim_app.actions import Action
from nvsim_app.layers.labels import short_id
from nvsim_app.look import lengths
from nvsim_app.look.plain_text import caption, plain
from nvsim_app.modes.mode import Pointer
from nvsim_app.state import edit_commands
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason, with_editing, with_frame_page, with_positions, writable
from nvsim_app.views.graph_surface import MapSurface
from nvsim_app.wiring.frames import FramePart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import Part, WindowContext
from nvsim_app.wiring.proposing import ProposePart


def _mode(name: str, text: str, tip: str, shortcut: str, enabled: Callable[[Document], Reason]) -> Action:
    return Action("&Graph", 0, f"mode_{name}", text, tip, lambda part: part.stage.choose(name), shortcut, enabled,
                  icon=f"mode_{name}", check="on" if name == "select" else "off", group="mode",
                  toolbar=True)  # fmt: skip


def _can_cancel(document: Document) -> Reason:
    return with_frame_page(document) and with_editing(document) and with_positions(document)


class ModePart(Part):
    """Commands that select a mode."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.stage = context.modes
        self.stage.changed.connect(self._show)
        self.stage.said.connect(self._show_hint)
        context.document.graphChanged.connect(self._leave_when_locked)

    def restore(self, settings: QSettings) -> None:
        """Attaches the modes to both views, after all parts exist."""
        context = self.context
        self.stage.attach(context.scene.surface)
        plan = context.part(MapPart).view
        self.stage.attach(MapSurface(plan, context.document))
        self.stage.listen(plan.plot)  # it has the keyboard focus, and a child widget has the mouse

    def _cancel(self) -> None:
        """Closes a dialog, else cancels the current action, else closes the frame page, else clears the selection."""
        if self.context.window.close_dialog():
            return
        if self.context.document.page_frame is None:
            self.stage.cancel()
        elif not self.stage.give_up():
            self.context.part(FramePart).browser.step_out()

    def _show(self, name: str) -> None:
        self.context.window.actions_table[f"mode_{name}"].setChecked(True)

    def _show_hint(self, text: str) -> None:
        self.context.window.statusBar().showMessage(plain(text))

    def _leave_when_locked(self, _: object) -> None:
        if not self.context.document.editing.writable and self.stage.current.name.startswith("add"):
            self.stage.choose("select")

    ACTIONS = (
        _mode("select", "&Select", "Click to select, drag the selection to move it", "V", with_editing),
        _mode("box", "Select by &box", "Drag a box around viewpoints", "B", with_editing),
        _mode("lasso", "Select by &lasso", "Draw a line around viewpoints", "K", with_editing),
        _mode("add_viewpoint", "Add &viewpoints", "Click the floor, a frame of the trajectory, or an edge", "P",
              writable),
        _mode("add_edge", "Add &edges", "Click two viewpoints to connect them", "C", writable),
        _mode("measure", "&Measure", "Click points to measure between them", "M", with_positions),
        Action("&Graph", 0, "cancel", "Cancel",
               "Cancel the current action, then return to the 3D view and to Select, then clear the selection", _cancel,
               "Esc", _can_cancel),
    )  # fmt: skip


_OF_THINGS = (
    ("inspect", "zoom_to", "grow", "component", "path"),
    ("join", "connect_visible", "split", "merge"),
    ("straighten", "align", "copy_to_floor", "set_height"),
    ("reviewed", "unreviewed", "lock", "unlock"),
    ("exclude", "include", "remove"),
)
_OF_THE_FLOOR = (("select_all", "propose_edges", "propose_viewpoints"),)


class ContextPart(Part):
    """Opens the context menu. It omits unavailable commands; the menu bar shows them with the reason."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        context.modes.menuWanted.connect(self.show)

    def show(self, pointer: Pointer) -> None:
        """Opens the menu at the mouse pointer."""
        menu = self.menu(pointer)
        menu.aboutToHide.connect(menu.deleteLater)
        menu.popup(pointer.surface.widget.mapToGlobal(pointer.point.toPoint()))

    def menu(self, pointer: Pointer) -> QMenu:
        """Creates the menu. Selects the item under the mouse pointer, unless it is already selected."""
        editing = self.context.document.editing
        viewpoint, edge = pointer.viewpoint, pointer.edge
        chosen = editing.selection
        if viewpoint is not None and viewpoint not in chosen.viewpoints:
            editing.select(GraphSelection(frozenset({viewpoint})))
        elif viewpoint is None and edge is not None and edge not in chosen.edges:
            editing.select(GraphSelection(frozenset(), frozenset({edge})))
        menu = QMenu(self.context.window, toolTipsVisible=True)
        self._add_ghost(menu, pointer)
        if viewpoint is None and edge is None:
            self._fill_for_floor(menu, pointer)
        else:
            self._fill_for_things(menu)
        if not editing.writable and editing.locked:
            menu.addSeparator()
            menu.addAction(caption(editing.locked)).setEnabled(False)
        return menu

    def _add_ghost(self, menu: QMenu, pointer: Pointer) -> None:
        proposing = self.context.part(ProposePart)
        ghost = proposing.proposal_under(pointer)
        if ghost is not None and pointer.viewpoint is None:
            menu.addAction("Accept this proposed edge", partial(proposing.accept_edge, ghost))
            menu.addAction("Dismiss it", partial(proposing.dismiss_edge, ghost))

    def _fill_for_things(self, menu: QMenu) -> None:
        graph, chosen = self.context.document.graph, self.context.document.editing.selection
        parts = [(len(chosen.viewpoints), "viewpoint"), (len(chosen.edges), "edge")]
        words = " and ".join(count_text(n, thing) for n, thing in parts if n)
        if len(chosen.viewpoints) + len(chosen.edges) == 1:
            ids = (*chosen.viewpoints, *(end for key in chosen.edges for end in key))
            words = " – ".join(short_id(graph, id) for id in ids)
        menu.addSection(caption(words))
        if len(chosen.viewpoints) == 1 and not chosen.edges and self.context.document.editing.writable:
            menu.addAction("Connect to…", self._connect)
        self._add(menu, _OF_THINGS, self._in_effect())

    def _connect(self) -> None:
        """Starts an edge at the selected viewpoint; the next click selects its other end."""
        self.context.modes.choose("select")  # a mode reads the selection when it begins
        self.context.modes.choose("add_edge")

    def _in_effect(self) -> set[str]:
        """Of each command and its opposite, the one that the menu omits: the one without an effect, or else the
        opposite."""
        graph, chosen = self.context.document.graph, self.context.document.editing.selection
        if graph is None:
            return set()
        viewpoints = [graph.viewpoints[id] for id in chosen.viewpoints]
        things: list[Viewpoint | Edge] = [*viewpoints, *(graph.edges[key] for key in chosen.edges)]
        return {
            "lock" if all(thing.locked for thing in things) else "unlock",
            "reviewed" if all(thing.reviewed for thing in things) else "unreviewed",
            "include" if any(viewpoint.included for viewpoint in viewpoints) else "exclude",
        }

    def _fill_for_floor(self, menu: QMenu, pointer: Pointer) -> None:
        editing, place = self.context.document.editing, pointer.surface.floor_point(pointer.point)
        if place is not None:
            menu.addSection(lengths.position_text(*place[:2]))
            if editing.writable:
                add = partial(edit_commands.add_viewpoint_on_floor, editing, place)
                menu.addAction("Add a viewpoint here", add)
                if len(editing.selection.viewpoints) == 1:
                    (near,) = editing.selection.viewpoints
                    name = caption(short_id(self.context.document.graph, near))
                    menu.addAction(f"Add a viewpoint here and connect it to {name}", partial(add, join=near))
        self._add(menu, _OF_THE_FLOOR)

    def _add(self, menu: QMenu, groups: tuple[tuple[str, ...], ...], omitted: Collection[str] = ()) -> None:
        table = self.context.window.actions_table
        for group in groups:
            usable = [table[name] for name in group if table[name].isEnabled() and name not in omitted]
            if usable:
                menu.addSeparator()
                menu.addActions(usable)
