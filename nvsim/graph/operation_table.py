"""The table of named edits: the arguments, the function, and the texts of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.graph import edits
from nvsim.graph.arguments import Argument, check_arguments
from nvsim.graph.edits import EditError, Visible
from nvsim.graph.history import name_or_count
from nvsim.graph.offers import ChoiceField, MenuEntry, NumberField, SelectionNeeds, selection_arguments
from nvsim.graph.selection import selection
from nvsim.graph.types import NavGraph
from nvsim.plain_text import count_text


@dataclass(frozen=True)
class EditContext:
    """Inputs of edits in addition to the graph. visible: line of sight between positions. trajectory: (N, 3) positions
    of the frames, meters, world."""

    visible: Visible | None = None
    trajectory: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Operation:
    """A named edit.

    name       name in scripts
    what       one line for help and menus
    function   (graph, surroundings, **arguments) -> graph
    arguments  in order
    words      arguments -> text for the history
    offers     how an editor offers it on the selection; none for edits that only scripts and the mouse make
    """

    name: str
    what: str
    function: Callable[..., NavGraph]
    arguments: tuple[Argument, ...]
    words: Callable[[Mapping[str, Any]], str]
    offers: tuple[MenuEntry, ...] = ()


def _with_graph_only(function: Callable[..., NavGraph]) -> Callable[..., NavGraph]:
    """Adapt an edit that needs only the graph and its arguments."""
    return lambda graph, surroundings, **arguments: function(graph, **arguments)


def _of_edge(function: Callable[..., NavGraph]) -> Callable[..., NavGraph]:
    def of_edge(graph: NavGraph, surroundings: EditContext, edge: tuple[str, str], **arguments: Any) -> NavGraph:
        return function(graph, *edge, **arguments)

    return of_edge


def _at_frame(graph: NavGraph, surroundings: EditContext, frame: int, **arguments: Any) -> NavGraph:
    walk = surroundings.trajectory
    if walk is None:
        raise EditError("There is no trajectory; give a position instead of a frame.")
    if not 0 <= frame < len(walk):
        raise EditError(f"There is no frame {frame}; the trajectory has {len(walk)} frames.")
    x, y, z = walk[frame].tolist()
    return edits.place_viewpoint(graph, (x, y, z), **arguments)


def _connect_visible(
    graph: NavGraph, surroundings: EditContext, viewpoints: tuple[str, ...] | None, distance: float, steep: float
) -> NavGraph:
    ids = graph.viewpoints if viewpoints is None else viewpoints
    return edits.connect_visible(graph, ids, distance, surroundings.visible, steep=steep)


def _apply_edits(graph: NavGraph, surroundings: EditContext, edits: tuple[dict[str, Any], ...], text: str) -> NavGraph:
    for each in edits:
        arguments = {name: value for name, value in each.items() if name != "edit"}
        operation = OPERATIONS.get(each["edit"])
        if operation is None or operation.function is _apply_edits:
            raise EditError(f"There is no edit {each['edit']!r} that can be combined with others.")
        graph = operation.function(
            graph, surroundings, **check_arguments(operation.name, operation.arguments, arguments)
        )
    return graph


def _viewpoints(arguments: Mapping[str, Any]) -> str:
    return name_or_count(arguments["ids"], "viewpoint")


def _mark_text(arguments: Mapping[str, Any]) -> str:
    parts = [(arguments["viewpoints"], "viewpoint"), (arguments["edges"], "edge")]
    return " and ".join(name_or_count(things, thing) for things, thing in parts if things) or "nothing"


_IDS = Argument("ids", "viewpoints", "ids of viewpoints")
_HEIGHT = Argument("height", "number", "height of the camera above the floor in meters", 1.5)
_ID = Argument("id", "name", "id of the new viewpoint; derived from its position by default", None)
_SUBMAP = Argument("submap", "integer", "index of the submap that renders it; -1 for none", -1)
_SOME = SelectionNeeds("viewpoints")
_PAIRS = Argument("pairs", "edges", "pairs of ids")
_MARKED = (
    Argument("viewpoints", "viewpoints", "ids of viewpoints", ()),
    Argument("edges", "edges", "pairs of ids", ()),
)


def _table(*operations: Operation) -> dict[str, Operation]:
    return {operation.name: operation for operation in operations}


OPERATIONS: dict[str, Operation] = _table(
    Operation(
        "add_viewpoint",
        "Add a viewpoint at a position",
        _with_graph_only(edits.place_viewpoint),
        (Argument("position", "place", "x, y, z of the camera in meters"), _HEIGHT, _SUBMAP, _ID),
        lambda a: "Add a viewpoint",
    ),
    Operation(
        "add_viewpoint_at_frame",
        "Add a viewpoint at the position of a frame of the trajectory",
        _at_frame,
        (Argument("frame", "integer", "index of the frame"), _HEIGHT, _SUBMAP, _ID),
        lambda a: f"Add a viewpoint at frame {a['frame']}",
    ),
    Operation(
        "split_edge",
        "Split an edge with a viewpoint",
        _of_edge(edits.split_edge),
        (
            Argument("edge", "edge", "two ids"),
            Argument("share", "number", "position along the edge, 0 to 1", 0.5),
            Argument("position", "place", "x, y, z in meters; replaces the point on the line", None),
            _ID,
        ),
        lambda a: "Split an edge",
        (
            MenuEntry(
                "split",
                "S&plit",
                "Add a viewpoint in the middle of the edge",
                2,
                SelectionNeeds("edges", 1, 1),
                arguments=lambda c: {"edge": list(c.edges[0])},
            ),
        ),
    ),
    Operation(
        "move_viewpoints",
        "Move viewpoints to given positions",
        _with_graph_only(edits.move_viewpoints),
        (Argument("positions", "places", "id -> x, y, z in meters"),),
        lambda a: f"Move {name_or_count(a['positions'], 'viewpoint')}",
    ),
    Operation(
        "shift_viewpoints",
        "Move viewpoints by one offset",
        _with_graph_only(edits.shift_viewpoints),
        (_IDS, Argument("by", "place", "dx, dy, dz in meters")),
        lambda a: f"Move {_viewpoints(a)}",
    ),
    Operation(
        "remove_viewpoints",
        "Remove viewpoints with their edges and evidence",
        _with_graph_only(edits.remove_viewpoints),
        (_IDS,),
        lambda a: f"Remove {_viewpoints(a)}",
    ),
    Operation(
        "include",
        "Include viewpoints in navigation, or exclude them and keep them in the file",
        _with_graph_only(edits.set_included),
        (_IDS, Argument("included", "flag", "false excludes them", True)),
        lambda a: f"{'Include' if a['included'] else 'Exclude'} {_viewpoints(a)}",
        (
            MenuEntry(
                "exclude",
                "&Exclude",
                "Keep the viewpoints in the file, but not in navigation",
                1,
                _SOME,
                "X",
                {"included": False},
            ),
            MenuEntry(
                "include",
                "&Include",
                "Use the viewpoints in navigation again",
                1,
                _SOME,
                "Shift+X",
                {"included": True},
            ),
        ),
    ),
    Operation(
        "rename_viewpoint",
        "Rename a viewpoint",
        _with_graph_only(edits.rename_viewpoint),
        (Argument("old", "name", "current id"), Argument("new", "name", "new id")),
        lambda a: "Rename a viewpoint",
    ),
    Operation(
        "set_height",
        "Set the height of cameras above the floor",
        _with_graph_only(edits.set_height),
        (_IDS, Argument("height", "number", "height above the floor in meters")),
        lambda a: f"Set the height of {_viewpoints(a)} to {a['height']:g} m",
        (
            MenuEntry(
                "set_height",
                "Set &height…",
                "Set the height of the camera above the floor",
                3,
                _SOME,
                asks=(NumberField("height", "Height above the floor", 1.5, 0.05, 10.0),),
                about="Moves the cameras of the selected viewpoints up or down. The floor does not change.",
            ),
        ),
    ),
    Operation(
        "merge_viewpoints",
        "Merge several viewpoints into one",
        _with_graph_only(edits.merge_viewpoints),
        (
            _IDS,
            Argument("into", "name", "id of the viewpoint to keep; the first by default", None),
            Argument("middle", "flag", "true moves it to the mean position of all", False),
        ),
        lambda a: f"Merge {_viewpoints(a)}",
        (
            MenuEntry(
                "merge",
                "Mer&ge",
                "Merge the viewpoints into one that has all their edges",
                2,
                SelectionNeeds("viewpoints", 2),
                "Ctrl+M",
                {"middle": True},
            ),
        ),
    ),
    Operation(
        "straighten",
        "Move a chain of viewpoints onto the line between its ends",
        _with_graph_only(edits.straighten),
        (_IDS, Argument("even", "flag", "true spaces them evenly", False)),
        lambda a: f"{'Space evenly' if a['even'] else 'Straighten'} {_viewpoints(a)}",
        (
            MenuEntry(
                "straighten",
                "Strai&ghten…",
                "Move a chain of viewpoints onto the line between its ends",
                3,
                SelectionNeeds("viewpoints", 3),
                asks=(ChoiceField("even", "Along the line", {False: "keep the distances", True: "space evenly"}),),
                about="Moves the selected chain of viewpoints onto the line between its ends.",
            ),
        ),
    ),
    Operation(
        "align_to_lattice",
        "Align viewpoints to the lattice of the map builder",
        _with_graph_only(edits.align_to_lattice),
        (
            _IDS,
            Argument("spacing", "number", "length of a step in meters", 2.5),
            Argument("offset", "number", "rotation of the directions in degrees", 7.5),
            Argument("anchor", "name", "id of the viewpoint that does not move", None),
        ),
        lambda a: f"Align {_viewpoints(a)}",
        (
            MenuEntry(
                "align",
                "&Align to the lattice…",
                "Move viewpoints to positions on the lattice",
                3,
                _SOME,
                asks=(
                    NumberField("spacing", "Step length", 2.5, 0.1, 20.0),
                    NumberField("offset", "Rotation", 7.5, -45.0, 45.0, "°", 1),
                ),
                about="Moves the selected viewpoints to lattice positions: whole steps in one of eight directions from "
                "viewpoints that are already aligned.",
            ),
        ),
    ),
    Operation(
        "copy_by",
        "Copy viewpoints and the edges between them to another floor",
        _with_graph_only(edits.copy_by),
        (
            _IDS,
            Argument("dz", "number", "offset upward in meters"),
            Argument("dx", "number", "offset along x in meters", 0.0),
            Argument("dy", "number", "offset along y in meters", 0.0),
        ),
        lambda a: f"Copy {_viewpoints(a)} by {a['dz']:g} m",
        (
            MenuEntry(
                "copy_to_floor",
                "Cop&y to another floor…",
                "Copy the viewpoints and their edges to a higher or lower floor",
                3,
                _SOME,
                asks=(NumberField("dz", "Higher by", 3.0, -100.0, 100.0),),
                about="Copies the selected viewpoints and the edges between them.",
            ),
        ),
    ),
    Operation(
        "add_edges",
        "Join pairs of viewpoints",
        _with_graph_only(edits.add_edges),
        (_PAIRS,),
        lambda a: f"Add {name_or_count(a['pairs'], 'edge')}",
        (
            MenuEntry(
                "join",
                "&Join",
                "Add an edge between the two viewpoints",
                2,
                SelectionNeeds("viewpoints", 2, 2),
                "Ctrl+J",
                arguments=lambda c: {"pairs": [list(c.viewpoints)]},
                selects=lambda c: selection(edges=[(c.viewpoints[0], c.viewpoints[1])]),
            ),
        ),
    ),
    Operation(
        "remove_edges",
        "Remove edges",
        _with_graph_only(edits.remove_edges),
        (_PAIRS,),
        lambda a: f"Remove {name_or_count(a['pairs'], 'edge')}",
    ),
    Operation(
        "connect_visible",
        "Join all viewpoints that see each other within a distance",
        _connect_visible,
        (
            Argument("distance", "number", "maximum distance in meters"),
            Argument("viewpoints", "viewpoints", "ids; all by default", None),
            Argument("steep", "number", "maximum slope of an edge in degrees", 45.0),
        ),
        lambda a: f"Connect visible viewpoints within {a['distance']:g} m",
        (
            MenuEntry(
                "connect_visible",
                "&Connect visible…",
                "Join all selected viewpoints that see each other within a distance",
                2,
                SelectionNeeds("viewpoints", 2),
                arguments=lambda c: {"viewpoints": list(c.viewpoints)},
                asks=(
                    NumberField("distance", "Maximum distance", 3.0, 0.1, 50.0),
                    NumberField("steep", "Maximum slope", 45.0, 1.0, 90.0, "°", 0, "Prevents edges between floors"),
                ),
                about="Joins all pairs of selected viewpoints that are close enough and see each other. Visibility "
                "comes from the map, or from the lists of the file if there is no map.",
            ),
        ),
    ),
    Operation(
        "mark_reviewed",
        "Mark viewpoints and edges as reviewed",
        _with_graph_only(edits.mark_reviewed),
        (*_MARKED, Argument("reviewed", "flag", "false removes the mark", True)),
        lambda a: f"Mark {_mark_text(a)} as {'reviewed' if a['reviewed'] else 'not reviewed'}",
        (
            MenuEntry(
                "reviewed",
                "Mark as re&viewed",
                "You checked it and found it correct",
                4,
                SelectionNeeds("things"),
                "Y",
                {"reviewed": True},
                selection_arguments,
            ),
            MenuEntry(
                "unreviewed",
                "Mark as not reviewed",
                "It needs another review",
                4,
                SelectionNeeds("things"),
                "Shift+Y",
                {"reviewed": False},
                selection_arguments,
            ),
        ),
    ),
    Operation(
        "lock",
        "Lock viewpoints and edges against edits",
        _with_graph_only(edits.set_locked),
        (*_MARKED, Argument("locked", "flag", "false unlocks", True)),
        lambda a: f"{'Lock' if a['locked'] else 'Unlock'} {_mark_text(a)}",
        (
            MenuEntry(
                "lock",
                "&Lock",
                "Protect it from edits until it is unlocked",
                4,
                SelectionNeeds("things"),
                "",
                {"locked": True},
                selection_arguments,
            ),
            MenuEntry(
                "unlock",
                "U&nlock",
                "Allow edits to change it again",
                4,
                SelectionNeeds("things"),
                "",
                {"locked": False},
                selection_arguments,
            ),
        ),
    ),
    Operation(
        "ignore_finding",
        "Ignore a finding for a reason",
        _with_graph_only(edits.ignore_finding),
        (Argument("key", "name", "key of the finding"), Argument("reason", "name", "why it is ignored")),
        lambda a: "Ignore a finding",
    ),
    Operation(
        "heed_finding",
        "Show an ignored finding again",
        _with_graph_only(edits.heed_finding),
        (Argument("key", "name", "key of the finding"),),
        lambda a: "Show a finding again",
    ),
    Operation(
        "together",
        "Apply several edits as one step",
        _apply_edits,
        (Argument("edits", "edits", "edits in order"), Argument("text", "name", "text for the history", "")),
        lambda a: a["text"] or count_text(len(a["edits"]), "edit"),
    ),
    Operation(
        "patch",
        "Add, replace and remove given viewpoints and edges",
        lambda graph, surroundings, text, **parts: edits.patch(graph, **parts),
        (
            Argument("viewpoints", "whole viewpoints", "added, or replacing those with equal ids", ()),
            Argument("edges", "whole edges", "added, or replacing those with equal ends", ()),
            Argument("no_viewpoints", "viewpoints", "ids to remove before anything is added", ()),
            Argument("no_edges", "edges", "pairs of ids to remove before anything is added", ()),
            Argument("text", "name", "text for the history", ""),
        ),
        lambda a: a["text"] or "Change the graph",
    ),
)
