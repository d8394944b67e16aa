"""The part that walks as an agent: its mode, its image over the 3D view, its panel, and the map that follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PySide6.QtCore import QSettings, Qt
from PySide6.QtWidgets import QApplication, QDockWidget

from nvsim.geometry.directions import HEIGHT, WIDTH
from nvsim.project.work import STAGE
from nvsim_app.actions import Action
from nvsim_app.agent.agent_walk import AgentWalk
from nvsim_app.agent.child import AgentSource
from nvsim_app.agent.mode import AgentMode
from nvsim_app.agent.panel import AgentPanel
from nvsim_app.agent.state import trajectory_json
from nvsim_app.agent.view import AgentView
from nvsim_app.layers.labels import short_id
from nvsim_app.painting import cameras
from nvsim_app.painting.picking import NEAR
from nvsim_app.state.document import Document
from nvsim_app.state.graph_files import ForeignGraph
from nvsim_app.state.reasons import Reason, with_editing
from nvsim_app.views.graph_surface import GraphSurface
from nvsim_app.wiring.inspector import InspectorPart
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import Dock, Part, WindowContext

_RIM = 0.1  # share of a view's width and height; an agent nearer to the border has left the view
_AROUND = 8.0  # meters of the map around an agent that left it
_DOWN, _REACH = -0.9, 7.0  # elevation (radians) and distance (meters) of the camera to an agent that left the 3D view


def with_standing(document: Document) -> Reason:
    """None if agents can use a viewpoint of the graph, otherwise the reason."""
    there = bool(document.graph_arrays.included.any())
    return with_editing(document) or (None if there else "the graph has no viewpoint that agents can use")


class AgentPart(Part):
    """Commands and views for walking as an agent."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        document, modes = context.document, context.modes
        self.walk = AgentWalk(document, self)
        self.view = AgentView(document, self.walk)
        self.panel = AgentPanel(self.walk)
        self.mode = AgentMode(modes.context, self.walk, self._begin, self._end, self.copy_state)
        modes.modes[self.mode.name] = self.mode
        modes.listen(self.view)
        context.window.center.addWidget(self.view)
        self._was_closed = False  # whether the agent panel was closed before the walk
        self._hidden: list[tuple[QDockWidget, bool]] = []  # docks hidden to make room; whether each was in front
        self._before: QDockWidget | None = None  # the panel that was in front of the agent's tab
        self._at = ""  # the viewpoint that was last selected and brought into view
        self._connect(document)

    def _connect(self, document: Document) -> None:
        walk, view, panel, window = self.walk, self.view, self.panel, self.context.window
        walk.changed.connect(self._follow_agent)
        walk.refused.connect(document.editing.refuse)
        walk.said.connect(self.context.notices.info)
        walk.failed.connect(self._on_failed)
        walk.ended.connect(self._on_ended)
        view.taken.connect(walk.take_viewpoint)
        view.pointedAt.connect(panel.point)
        panel.pointedAt.connect(view.point)
        panel.taken.connect(walk.take_viewpoint)
        panel.restrictedChosen.connect(walk.set_restricted)
        panel.imageChosen.connect(self._show_image)
        panel.copyStateWanted.connect(self.copy_state)
        panel.copyTrajectoryWanted.connect(self.copy_trajectory)
        window.center.currentChanged.connect(self._on_page)
        document.projectLeft.connect(self._leave_mode)
        document.contentsChanged.connect(self._on_contents)

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("agent", "Agent", self.panel, "right", tab="details", needs=with_editing),)

    def restore(self, settings: QSettings) -> None:
        restricted = settings.value("agent/restricted", "true") in (True, "true")
        self.panel.restricted.setChecked(restricted)
        self._map = self.context.part(MapPart).view

    def store(self, settings: QSettings) -> None:
        settings.setValue("agent/restricted", self.panel.restricted.isChecked())
        self.walk.stop()

    # Beginning and ending -----------------------------------------------------------------------------------------

    def _begin(self) -> None:
        document, scene, window = self.context.document, self.context.scene, self.context.window
        chosen = document.selected_viewpoint
        if chosen is not None and not chosen.included:
            name = short_id(document.graph, chosen.id)
            self.context.notices.info(
                f"{name} is excluded from navigation; the agent starts at the nearest included viewpoint."
            )
        place = scene.pose.position if chosen is None else chosen.position
        self._at = ""
        self._make_room()
        self.context.part(InspectorPart).draw_only_in_front(True)
        own = self.context.window.docks["agent"]
        self._was_closed = own.isHidden()
        in_front = [d for d in window.docks.values() if _in_front(d)]
        window.show_dock("agent")
        self._before = next((d for d in window.tabifiedDockWidgets(own) if d in in_front), None)
        window.show_page(self.view)
        self.view.setFocus()
        self.walk.begin(self._source(), np.array(place), scene.pose.heading)

    def _end(self) -> None:
        """Ends the walk. The 3D view continues from the place of the agent."""
        state, window, scene = self.walk.state, self.context.window, self.context.scene
        self.walk.stop()
        self.context.part(InspectorPart).draw_only_in_front(False)
        seen = window.center.currentWidget() is self.view
        if seen:
            window.show_page(None)
            scene.setFocus()
        for dock, _ in self._hidden:
            dock.show()
        for dock in (dock for dock, front in self._hidden if front):
            dock.raise_()
        self._hidden = []
        if self._before is not None and _in_front(self.context.window.docks["agent"]):
            self._before.raise_()
        if self._was_closed:
            self.context.window.docks["agent"].hide()
        if seen and state is not None and state.location.viewpointId in self.context.document.graph_arrays.index:
            scene.places.go_to_position(state.position, state.heading)

    def _leave_mode(self) -> None:
        if self.context.modes.current is self.mode:
            self.context.modes.choose("select")

    def _on_ended(self, why: str) -> None:
        self.context.notices.add("warning", why)
        self._leave_mode()

    def _on_failed(self, why: str, trace: str) -> None:
        self.context.notices.add("warning", why, trace)

    def _make_room(self) -> None:
        """Hides the panels on the left and at the bottom if the image would not fit."""
        window = self.context.window
        short = {
            Qt.DockWidgetArea.LeftDockWidgetArea: window.center.width() < WIDTH,
            Qt.DockWidgetArea.BottomDockWidgetArea: window.center.height() < HEIGHT,
        }
        docks = [d for d in window.findChildren(QDockWidget) if not d.isHidden() and not d.isFloating()]
        docks = [dock for dock in docks if short.get(window.dockWidgetArea(dock), False)]
        self._hidden = [(dock, _in_front(dock)) for dock in docks]
        for dock in docks:
            dock.hide()

    def _source(self) -> AgentSource:
        contents = self.context.document.contents
        file = contents.graph_file
        if isinstance(file, ForeignGraph):
            lacking = (
                ""
                if file.skyboxes is not None
                else "the folder of the file has no skyboxes; the map and the state work."
            )
            return AgentSource(None, file.path, file.skyboxes, lacking)
        lacking = f"{STAGE['train'].missing}; the map and the state work."
        return AgentSource(contents.path, lacking="" if contents.scene_stamp is not None else lacking)

    # Following ----------------------------------------------------------------------------------------------------

    def _on_contents(self, parts: frozenset[str]) -> None:
        if not self.walk.active:
            return
        if self.context.document.graph is None:
            self._leave_mode()
            return
        if "graph" in parts:
            self.walk.follow_graph()
        if "scene_stamp" in parts:
            self.walk.draw_from(self._source())

    def _follow_agent(self) -> None:
        """Follows a move or a turn of the agent."""
        state, document = self.walk.state, self.context.document
        self.context.modes.refresh()
        if state is None or state.location.viewpointId == self._at:
            return
        self._at = state.location.viewpointId
        document.select(viewpoint=self._at)
        self._bring_into_view()

    def _bring_into_view(self) -> None:
        document = self.context.document
        row = document.graph_arrays.index.get(self._at)
        if row is None:
            return
        foot = document.graph_arrays.feet[row]
        scene, modes = self.context.scene, self.context.modes
        for surface in (canvas.surface for canvas in modes.canvases if canvas.surface.widget.isVisible()):
            if _is_in_view(surface, foot):
                continue
            if surface is scene.surface:
                # From above, so that no wall is between the camera and the agent.
                above = replace(scene.pose, elevation=min(scene.pose.elevation, _DOWN))
                scene.navigation.go_to(cameras.focused(above, foot, _REACH))
            else:
                self._map.center_on(float(foot[0]), float(foot[1]), _AROUND)

    def _on_page(self, _: int) -> None:
        self.panel.image.setChecked(self.context.window.center.currentWidget() is self.view)

    def _show_image(self, on: bool) -> None:
        window = self.context.window
        if self.walk.active and on != (window.center.currentWidget() is self.view):
            window.show_page(self.view if on else None)
            (self.view if on else self.context.scene).setFocus()
            self._bring_into_view()

    # Copying ------------------------------------------------------------------------------------------------------

    def copy_state(self) -> None:
        """Copies all fields of the state as JSON."""
        if self.walk.state is not None:
            QApplication.clipboard().setText(self.walk.state.json())
            self.context.modes.said.emit("The agent's state is copied as JSON.")

    def copy_trajectory(self) -> None:
        """Copies the poses from the start, in the format of a leaderboard's file."""
        if self.walk.state is not None:
            QApplication.clipboard().setText(trajectory_json(self.walk.trajectory))
            self.context.modes.said.emit("The trajectory is copied as JSON.")

    ACTIONS = (
        Action("&Graph", 9, "mode_agent", "&Walk as an agent",
               "Show the observation of an agent at the selected viewpoint, and move like it: 30° turns and edges",
               lambda self: self.context.modes.choose("agent"), "F6", with_standing, icon="mode_agent", check="off",
               group="mode", toolbar=True),
    )  # fmt: skip


def _in_front(dock: QDockWidget) -> bool:
    """Whether a dock is visible and not behind another tab. Qt moves the docks of hidden tabs outside the window."""
    return not dock.isHidden() and (dock.isFloating() or dock.geometry().right() >= 0)


def _is_in_view(surface: GraphSurface, place: np.ndarray) -> bool:
    """Whether a world position (3,) is in view, and not near the border."""
    pixels, depths = surface.project(place[None])
    width, height = surface.widget.width(), surface.widget.height()
    inside = _RIM * width <= pixels[0, 0] <= (1 - _RIM) * width and _RIM * height <= pixels[0, 1] <= (1 - _RIM) * height
    return bool(depths[0] > NEAR and inside)
