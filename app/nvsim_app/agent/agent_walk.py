"""The walk that the window shows: user actions become steps, and a simulator process computes the resulting state."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, QTimer, Signal

from nvsim_app.agent.child import AgentSource, RefusedStep, StateImage, WalkRequest, WalkState, serve
from nvsim_app.agent.state import AgentState, Pose, Step, Walk, WalkedGraph
from nvsim_app.layers.labels import short_id
from nvsim_app.processes.child import RESTARTS, ChildProgram
from nvsim_app.processes.side_process import SideProcess
from nvsim_app.state.document import Document

_PROGRAM = ChildProgram(
    serve,
    "agent",
    "The walk cannot be simulated",
    "close other programs and try again",
    "The simulator stopped repeatedly; select Graph > Walk as an agent to try again.",
    RESTARTS,
)


class AgentLink(SideProcess):
    """Sends walks to the simulator process and emits its answers.

    walked(Walked), refused(Refused)   the answer to the newest walk; answers to older walks are dropped
    seen(Seen)                         the image of the newest walk, after `walked`
    troubled(str)                      the process stopped and was restarted
    gaveUp(str)                        the process stopped and will not be restarted
    """

    walked = Signal(object)
    refused = Signal(object)
    seen = Signal(object)
    troubled = Signal(str)
    gaveUp = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(_PROGRAM, parent)
        self.heard.connect(self._on_heard)
        self.restarted.connect(self._on_restart)
        self.ended.connect(lambda end: self.gaveUp.emit(end.sentence))
        self._graph: WalkedGraph | None = None
        self._unknown_since = 0  # number of the first request since the graph was set or the process started
        self._known = False  # whether the process answered one of these requests, so that it has the graph
        self._walk: Walk | None = None  # the newest
        self._requested = 0

    def open(self, source: object) -> None:
        """Starts the process on an AgentSource, and ends the running one. The newest walk is sent again."""
        super().open(source)
        self._ask_again()

    def reset(self) -> None:
        """Ends the process and discards the graph and the newest walk."""
        self.close()
        self.cancel(WalkRequest)
        self._walk = self._graph = None

    def set_graph(self, graph: WalkedGraph) -> None:
        """Sets the graph of all later requests."""
        self._graph, self._known, self._unknown_since = graph, False, self._requested + 1

    def ask_walk(self, walk: Walk) -> None:
        """Requests a walk."""
        self._walk = walk
        self._requested += 1
        self.ask(WalkRequest(self._requested, walk, None if self._known else self._graph))

    def _ask_again(self) -> None:
        """Repeats the newest walk in a new process, which does not have the graph."""
        if self._graph is not None:
            self.set_graph(self._graph)
        if self._walk is not None:
            self.ask_walk(self._walk)

    def _on_heard(self, message: object) -> None:
        assert isinstance(message, WalkState | RefusedStep | StateImage)
        self._known = self._known or message.number >= self._unknown_since
        if message.number == self._requested:
            kinds = {WalkState: self.walked, RefusedStep: self.refused, StateImage: self.seen}
            kinds[type(message)].emit(message)

    def _on_restart(self) -> None:
        self.troubled.emit("The simulator stopped and was restarted; the walk continues at the same place.")
        self._ask_again()


_WAITING = 8  # maximum number of actions that are queued while the simulator computes
_NOWHERE = "The graph has no included viewpoint left; the walk ends."


class AgentWalk(QObject):
    """The current walk of the agent: sends actions to the simulator and stores the newest state and image.

    changed()          the state or the trajectory changed, or the walk ended
    pictured()         the image changed, or the reason why there is none
    refused(str)       why an action is not possible
    said(str)          a notice for the user
    failed(str, str)   rendering failed unexpectedly: message and traceback
    ended(str)         why the walk cannot continue
    """

    changed = Signal()
    pictured = Signal()
    refused = Signal(str)
    said = Signal(str)
    failed = Signal(str, str)
    ended = Signal(str)

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.link = AgentLink(self)
        self.restricted = True
        self.state: AgentState | None = None
        self.trajectory: tuple[Pose, ...] = ()
        self.pixels: NDArray[np.uint8] | None = None
        """(480, 640, 3) uint8, blue, green, red: the newest image. It shows `state` unless `drawing`."""
        self.no_image = ""
        """Why there is no image of `state`."""
        self.drawing = False
        self._walk: Walk | None = None
        self._asked = False  # a request awaits its answer
        self._waiting: deque[Callable[[], None]] = deque()
        self._edited = QTimer(self, singleShot=True, interval=0)  # merges the edits of a multi-step undo
        self._edited.timeout.connect(self._follow_graph)
        document.graphChanged.connect(self.follow_graph)
        self.link.walked.connect(self._on_walked)
        self.link.refused.connect(self._on_refused)
        self.link.seen.connect(self._on_seen)
        self.link.troubled.connect(self.said)
        self.link.gaveUp.connect(self.ended)

    @property
    def active(self) -> bool:
        return self._walk is not None

    # Beginning and ending -----------------------------------------------------------------------------------------

    def begin(self, source: AgentSource, place: NDArray[np.float64], heading: float) -> None:
        """Begins at the included viewpoint nearest to `place` ((3,) meters, world), with elevation 0 and `heading` in
        radians. The graph must have an included viewpoint."""
        self.stop()
        start = self._nearest(place)
        assert start is not None
        self._walk = Walk(Pose(start, heading, 0.0), (), self.restricted)
        self.link.set_graph(walked_graph(self._document))
        self.link.open(source)
        self._ask(self._walk)

    def stop(self) -> None:
        """Ends the walk and the process. You can call it more than once."""
        self._edited.stop()
        self._walk, self.state, self.trajectory = None, None, ()
        self.pixels, self.no_image, self.drawing = None, "", False
        self._asked = False
        self._waiting.clear()
        self.link.reset()
        self.changed.emit()

    def draw_from(self, source: AgentSource) -> None:
        """Renders the images from another source, for example after the models changed."""
        if self._walk is not None:
            self.drawing = True
            self.link.open(source)

    # Actions of the user ------------------------------------------------------------------------------------------

    def turn(self, right: int, up: int) -> None:
        """Turns by 30 degrees. Only the signs are used: positive is right and up."""
        self._run_when_answered(lambda: self._go_on(Step("", right, up)))

    def move_to_location(self, index: int) -> None:
        """Moves to the navigable location with this index; 0 is the action to stay."""
        self._run_when_answered(lambda: self._move_to_location(index))

    def take_viewpoint(self, id: str) -> None:
        """Moves to the navigable location with this viewpoint id."""
        self._run_when_answered(lambda: self._move_to_location(self.index_of(id)))

    def undo_action(self) -> None:
        """Undoes the last action, without adding to the trajectory."""
        self._run_when_answered(lambda: self._undo_to(1))

    def home(self) -> None:
        """Undoes all actions."""
        self._run_when_answered(lambda: self._undo_to(len(self._walk.steps) if self._walk else 0))

    def set_restricted(self, on: bool) -> None:
        """Sets whether only locations in the horizontal field of view are navigable."""
        self.restricted = on
        if self._walk is not None and self._walk.restricted != on:
            self._ask(Walk(self._walk.start, self._walk.steps, on))

    def index_of(self, id: str) -> int:
        """The index of a viewpoint among the navigable locations, -1 if it is not navigable."""
        places = () if self.state is None else self.state.navigableLocations
        return next((i for i, place in enumerate(places) if i and place.viewpointId == id), -1)

    def _run_when_answered(self, what: Callable[[], None]) -> None:
        """Runs an action when the pending answer has arrived, because location indices refer to the current state."""
        if self._walk is None or self.state is None:
            return
        if not self._asked:
            what()
        elif len(self._waiting) < _WAITING:
            self._waiting.append(what)

    def _move_to_location(self, index: int) -> None:
        places = () if self.state is None else self.state.navigableLocations
        if 0 <= index < len(places):
            self._go_on(Step(places[index].viewpointId if index else ""))
        elif index < 0:
            self.refused.emit("That viewpoint is not navigable from here; turn toward it, or go nearer.")
        else:
            many = f"The navigable locations are 0 to {len(places) - 1}" if len(places) > 1 else "None is in view"
            self.refused.emit(f"There is no navigable location {index}. {many}; turn to see others.")

    def _undo_to(self, steps: int) -> None:
        assert self._walk is not None
        if not self._walk.steps:
            self.refused.emit("The agent is at its start.")
            return
        self._ask(Walk(self._walk.start, self._walk.steps[:-steps], self._walk.restricted))

    def _go_on(self, step: Step) -> None:
        assert self._walk is not None
        self._ask(self._walk.with_step(step))

    # The simulator ------------------------------------------------------------------------------------------------

    def _ask(self, walk: Walk) -> None:
        self._walk, self._asked, self.drawing = walk, True, True
        self.link.ask_walk(walk)

    def _on_walked(self, answer: WalkState) -> None:
        self._asked = False
        self.state, self.trajectory, self.no_image = answer.state, answer.trajectory, ""
        self.changed.emit()
        while self._waiting and not self._asked:
            self._waiting.popleft()()

    def _on_seen(self, answer: StateImage) -> None:
        self.drawing = False
        self.pixels, self.no_image = answer.pixels, answer.why
        if answer.trace:
            self.failed.emit(answer.why, answer.trace)
        self.pictured.emit()

    def _on_refused(self, answer: RefusedStep) -> None:
        """Begins a new episode at the agent's viewpoint, or at the nearest one, if an edit made the walk impossible."""
        assert self._walk is not None
        self._asked = False
        self._waiting.clear()
        here = self._walk.start if self.state is None else self.state.pose
        place = self._place_of(here)
        start = None if place is None else self._nearest(place)
        if start is None:
            self.ended.emit(_NOWHERE)
            return
        if answer.at < 0 and start == self._walk.start.viewpoint:
            self.ended.emit(answer.why)
            return
        if start == here.viewpoint:
            self.said.emit("An edit broke the agent's path; a new episode begins at its current viewpoint.")
        else:
            gone, near = self.name_of(here.viewpoint), self.name_of(start)
            self.said.emit(f"An edit removed or excluded {gone}; a new episode begins at {near}, the nearest.")
        self._ask(Walk(Pose(start, here.heading, here.elevation), (), self.restricted))

    def name_of(self, id: str) -> str:
        """The short name of a viewpoint in the window."""
        return short_id(self._document.graph, id)

    # The graph ----------------------------------------------------------------------------------------------------

    def follow_graph(self, _: object = None) -> None:
        """Repeats the walk on the current graph of the document, if a walk is active."""
        if self._walk is not None:
            self._edited.start()

    def _follow_graph(self) -> None:
        if self._walk is None:
            return
        if not self._document.graph_arrays.included.any():
            self.ended.emit(_NOWHERE)
            return
        self.link.set_graph(walked_graph(self._document))
        self._ask(self._walk)

    def _place_of(self, pose: Pose) -> NDArray[np.float64] | None:
        """(3,) meters, world: the current position of the viewpoint, or the agent's last position if it was removed."""
        row = self._document.graph_arrays.index.get(pose.viewpoint)
        if row is not None:
            return self._document.graph_arrays.positions[row]
        return None if self.state is None else self.state.position

    def _nearest(self, place: NDArray[np.float64]) -> str | None:
        """The included viewpoint nearest to `place` (3,)."""
        arrays = self._document.graph_arrays
        rows = np.flatnonzero(arrays.included)
        if not len(rows):
            return None
        return arrays.ids[rows[np.argmin(np.linalg.norm(arrays.positions[rows] - place, axis=1))]]


def walked_graph(document: Document) -> WalkedGraph:
    """The edited graph of the document, in the order of the saved file."""
    graph, arrays = document.graph, document.graph_arrays
    if graph is None:
        return WalkedGraph((), np.zeros(0, bool), np.zeros((0, 3)), np.zeros((0, 2), np.int64))
    ids = tuple(graph.viewpoints)
    order = np.array([arrays.index[id] for id in ids], np.int64)
    row = np.zeros(len(ids), np.int64)
    row[order] = np.arange(len(ids))
    return WalkedGraph(ids, arrays.included[order], arrays.positions[order], row[arrays.edges])
