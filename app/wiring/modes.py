"""The modes of editing in the menus, the toolbar, and the views."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings

from app.actions import Action
from app.look.plain_text import plain
from app.state.document import Document
from app.state.graph_reasons import with_editing, writable
from app.state.reasons import Reason, with_page, with_positions
from app.views.graph_surface import MapSurface
from app.wiring.frames import FramePart
from app.wiring.panels import MapPart
from app.wiring.part import Part, WindowContext

_SECTION = 0


def _mode(
    name: str, text: str, tip: str, shortcut: str, enabled: Callable[[Document], Reason], first: bool = False
) -> Action:
    return Action(
        f"mode_{name}",
        text,
        tip,
        "&Graph",
        _SECTION,
        shortcut,
        f"mode_{name}",
        "on" if first else "off",
        "mode",
        toolbar=True,
        enabled=enabled,
    )


class ModePart(Part):
    """Commands that select a mode."""

    ACTIONS = (
        _mode("select", "&Select", "Click to select, drag the selection to move it", "V", with_editing, first=True),
        _mode("box", "Select by &box", "Drag a box around viewpoints", "B", with_editing),
        _mode("lasso", "Select by &lasso", "Draw a line around viewpoints", "K", with_editing),
        _mode(
            "add_viewpoint", "Add &viewpoints", "Click the floor, a frame of the trajectory, or an edge", "P", writable
        ),
        _mode("add_edge", "Add &edges", "Click two viewpoints to connect them", "C", writable),
        _mode("measure", "&Measure", "Click points to measure between them", "M", with_positions),
        Action("cancel", "Cancel",
               "Cancel the current action, then return to the 3D view and to Select, then clear the selection",
               "&Graph", _SECTION, "Esc",
               enabled=lambda document: with_page(document) and with_editing(document) and with_positions(document)),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.stage = context.modes
        self.stage.changed.connect(self._show)
        self.stage.said.connect(self._say)
        context.document.graphChanged.connect(self._leave_when_locked)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        handlers: dict[str, Callable[..., object]] = {"cancel": self._cancel}
        for name in self.stage.modes:
            handlers[f"mode_{name}"] = lambda _=False, n=name: self.stage.choose(n)
        return handlers

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

    def _say(self, text: str) -> None:
        self.context.window.statusBar().showMessage(plain(text))

    def _leave_when_locked(self, _: object) -> None:
        if not self.context.document.editing.writable and self.stage.current.name.startswith("add"):
            self.stage.choose("select")
