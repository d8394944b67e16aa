"""The table of named edits: what each takes, what it does, and its words for the history."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.graph import edits
from nvsim.graph.arguments import Argument, checked
from nvsim.graph.edits import EditError, Visible
from nvsim.graph.history import counted, named
from nvsim.graph.offers import Choice, Needs, Number, Offer, marked
from nvsim.graph.selection import selection
from nvsim.graph.types import NavGraph


@dataclass(frozen=True)
class EditContext:
    """What edits may need beside the graph. visible: who sees whom; trajectory: (N, 3) metres, world, of the frames."""

    visible: Visible | None = None
    trajectory: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class Operation:
    """name       as in scripts
    what       one line for help and menus
    function   (graph, surroundings, **arguments) -> graph
    arguments  in order
    words      arguments -> what was done, for the history
    offers     how an editor offers it on what is selected; none for what only scripts and the mouse do
    """

    name: str
    what: str
    function: Callable[..., NavGraph]
    arguments: tuple[Argument, ...]
    words: Callable[[Mapping[str, Any]], str]
    offers: tuple[Offer, ...] = ()


def _pure(function: Callable[..., NavGraph]) -> Callable[..., NavGraph]:
    """An edit that needs nothing beside the graph and its arguments."""
    return lambda graph, surroundings, **arguments: function(graph, **arguments)


def _of_edge(function: Callable[..., NavGraph]) -> Callable[..., NavGraph]:
    def of_edge(graph: NavGraph, surroundings: EditContext, edge: tuple[str, str], **arguments: Any) -> NavGraph:
        return function(graph, *edge, **arguments)

    return of_edge


def _at_frame(graph: NavGraph, surroundings: EditContext, frame: int, **arguments: Any) -> NavGraph:
    walk = surroundings.trajectory
    if walk is None:
        raise EditError("There is no trajectory whose frames could be named.")
    if not 0 <= frame < len(walk):
        raise EditError(f"There is no frame {frame}; the trajectory has {len(walk)}.")
    x, y, z = walk[frame].tolist()
    return edits.place_viewpoint(graph, (x, y, z), **arguments)


def _connect_visible(
    graph: NavGraph, surroundings: EditContext, viewpoints: tuple[str, ...] | None, distance: float, steep: float
) -> NavGraph:
    ids = graph.viewpoints if viewpoints is None else viewpoints
    return edits.connect_visible(graph, ids, distance, surroundings.visible, steep=steep)


def _together(graph: NavGraph, surroundings: EditContext, edits: tuple[dict[str, Any], ...], text: str) -> NavGraph:
    for each in edits:
        arguments = {name: value for name, value in each.items() if name != "edit"}
        operation = OPERATIONS.get(each["edit"])
        if operation is None or operation.function is _together:
            raise EditError(f"There is no edit {each['edit']!r} that could be done together with others.")
        graph = operation.function(graph, surroundings, **checked(operation.name, operation.arguments, arguments))
    return graph


def _viewpoints(arguments: Mapping[str, Any]) -> str:
    return named(arguments["ids"], "viewpoint")


def _marked(arguments: Mapping[str, Any]) -> str:
    parts = [(arguments["viewpoints"], "viewpoint"), (arguments["edges"], "edge")]
    return " and ".join(named(things, thing) for things, thing in parts if things) or "nothing"


_IDS = Argument("ids", "viewpoints", "ids of viewpoints")
_HEIGHT = Argument("height", "number", "metres of the camera above the floor", 1.5)
_ID = Argument("id", "name", "id of the new viewpoint; made from its place when left out", None)
_SUBMAP = Argument("submap", "integer", "index of the submap that renders it; -1 for none", -1)
_SOME = Needs("viewpoints")
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
        "Add a viewpoint at a place",
        _pure(edits.place_viewpoint),
        (Argument("position", "place", "x, y, z metres of the camera"), _HEIGHT, _SUBMAP, _ID),
        lambda a: "Add a viewpoint",
    ),
    Operation(
        "add_viewpoint_at_frame",
        "Add a viewpoint where a frame of the trajectory was taken",
        _at_frame,
        (Argument("frame", "integer", "index of the frame"), _HEIGHT, _SUBMAP, _ID),
        lambda a: f"Add a viewpoint at frame {a['frame']}",
    ),
    Operation(
        "split_edge",
        "Put a viewpoint on an edge",
        _of_edge(edits.split_edge),
        (
            Argument("edge", "edge", "two ids"),
            Argument("share", "number", "0 to 1 of the way", 0.5),
            Argument("position", "place", "x, y, z metres in place of the point on the line", None),
            _ID,
        ),
        lambda a: "Split an edge",
        (
            Offer(
                "split",
                "S&plit",
                "A viewpoint in the middle of the edge",
                2,
                Needs("edges", 1, 1),
                arguments=lambda c: {"edge": list(c.edges[0])},
            ),
        ),
    ),
    Operation(
        "move_viewpoints",
        "Move viewpoints each to its place",
        _pure(edits.move_viewpoints),
        (Argument("positions", "places", "id -> x, y, z metres"),),
        lambda a: f"Move {named(a['positions'], 'viewpoint')}",
    ),
    Operation(
        "shift_viewpoints",
        "Move viewpoints by the same way",
        _pure(edits.shift_viewpoints),
        (_IDS, Argument("by", "place", "dx, dy, dz metres")),
        lambda a: f"Move {_viewpoints(a)}",
    ),
    Operation(
        "remove_viewpoints",
        "Remove viewpoints with their edges and evidence",
        _pure(edits.remove_viewpoints),
        (_IDS,),
        lambda a: f"Remove {_viewpoints(a)}",
    ),
    Operation(
        "include",
        "Take viewpoints into navigation, or out of it while they stay in the file",
        _pure(edits.set_included),
        (_IDS, Argument("included", "flag", "false takes them out", True)),
        lambda a: f"{'Include' if a['included'] else 'Exclude'} {_viewpoints(a)}",
        (
            Offer(
                "exclude",
                "&Exclude",
                "Keep the viewpoints in the file but out of navigation",
                1,
                _SOME,
                "X",
                {"included": False},
            ),
            Offer(
                "include",
                "&Include",
                "Take the viewpoints into navigation again",
                1,
                _SOME,
                "Shift+X",
                {"included": True},
            ),
        ),
    ),
    Operation(
        "rename_viewpoint",
        "Give a viewpoint another id",
        _pure(edits.rename_viewpoint),
        (Argument("old", "name", "the id now"), Argument("new", "name", "the id then")),
        lambda a: "Rename a viewpoint",
    ),
    Operation(
        "set_height",
        "Set the height of cameras above their floor",
        _pure(edits.set_height),
        (_IDS, Argument("height", "number", "metres above the floor")),
        lambda a: f"Set the height of {_viewpoints(a)} to {a['height']:g} m",
        (
            Offer(
                "set_height",
                "Set &height…",
                "How high the camera stands above the floor",
                3,
                _SOME,
                asks=(Number("height", "Above the floor", 1.5, 0.05, 10.0),),
                about="Moves the cameras of the selected viewpoints up or down; their floor stays.",
            ),
        ),
    ),
    Operation(
        "merge_viewpoints",
        "Make one viewpoint of several",
        _pure(edits.merge_viewpoints),
        (
            _IDS,
            Argument("into", "name", "id of the one that stays; the first when left out", None),
            Argument("middle", "flag", "it moves to the middle of them all", False),
        ),
        lambda a: f"Merge {_viewpoints(a)}",
        (
            Offer(
                "merge",
                "Mer&ge",
                "The viewpoints become one, with the edges of all",
                2,
                Needs("viewpoints", 2),
                "Ctrl+M",
                {"middle": True},
            ),
        ),
    ),
    Operation(
        "straighten",
        "Lay a chain of viewpoints on the line between its ends",
        _pure(edits.straighten),
        (_IDS, Argument("even", "flag", "at equal distances", False)),
        lambda a: f"{'Space evenly' if a['even'] else 'Straighten'} {_viewpoints(a)}",
        (
            Offer(
                "straighten",
                "Strai&ghten…",
                "Put a chain of viewpoints on the line between its ends",
                3,
                Needs("viewpoints", 3),
                asks=(
                    Choice("even", "Along the line", {False: "keep the distances as they are", True: "space evenly"}),
                ),
                about="Puts the chain of the selected viewpoints on the line between its ends.",
            ),
        ),
    ),
    Operation(
        "align_to_lattice",
        "Lay viewpoints on the lattice of the map builder",
        _pure(edits.align_to_lattice),
        (
            _IDS,
            Argument("spacing", "number", "metres of a step", 2.5),
            Argument("offset", "number", "degrees that the directions are turned by", 7.5),
            Argument("anchor", "name", "id of the viewpoint that stays", None),
        ),
        lambda a: f"Align {_viewpoints(a)}",
        (
            Offer(
                "align",
                "&Align to the lattice…",
                "Put viewpoints where whole steps lead",
                3,
                _SOME,
                asks=(
                    Number("spacing", "Step", 2.5, 0.1, 20.0),
                    Number("offset", "Turned by", 7.5, -45.0, 45.0, "°", 1),
                ),
                about="Moves the selected viewpoints to where whole steps in one of eight directions lead from what is "
                "aligned already.",
            ),
        ),
    ),
    Operation(
        "copy_by",
        "Copy viewpoints and the edges among them, to another floor",
        _pure(edits.copy_by),
        (
            _IDS,
            Argument("dz", "number", "metres up"),
            Argument("dx", "number", "metres along x", 0.0),
            Argument("dy", "number", "metres along y", 0.0),
        ),
        lambda a: f"Copy {_viewpoints(a)} by {a['dz']:g} m",
        (
            Offer(
                "copy_to_floor",
                "Cop&y to another floor…",
                "The same viewpoints and edges, higher or lower",
                3,
                _SOME,
                asks=(Number("dz", "Higher by", 3.0, -100.0, 100.0),),
                about="Makes the selected viewpoints and the edges among them again.",
            ),
        ),
    ),
    Operation(
        "add_edges",
        "Join pairs of viewpoints",
        _pure(edits.add_edges),
        (_PAIRS,),
        lambda a: f"Add {named(a['pairs'], 'edge')}",
        (
            Offer(
                "join",
                "&Join",
                "An edge between the two viewpoints",
                2,
                Needs("viewpoints", 2, 2),
                "Ctrl+J",
                arguments=lambda c: {"pairs": [list(c.viewpoints)]},
                selects=lambda c: selection(edges=[(c.viewpoints[0], c.viewpoints[1])]),
            ),
        ),
    ),
    Operation(
        "remove_edges",
        "Remove edges",
        _pure(edits.remove_edges),
        (_PAIRS,),
        lambda a: f"Remove {named(a['pairs'], 'edge')}",
    ),
    Operation(
        "connect_visible",
        "Join all viewpoints within a distance that see each other",
        _connect_visible,
        (
            Argument("distance", "number", "metres"),
            Argument("viewpoints", "viewpoints", "ids; all when left out", None),
            Argument("steep", "number", "degrees that an edge may rise at most", 45.0),
        ),
        lambda a: f"Connect what sees each other within {a['distance']:g} m",
        (
            Offer(
                "connect_visible",
                "&Connect visible…",
                "Join all of the viewpoints that see each other within a distance",
                2,
                Needs("viewpoints", 2),
                arguments=lambda c: {"viewpoints": list(c.viewpoints)},
                asks=(
                    Number("distance", "At most apart", 3.0, 0.1, 50.0),
                    Number("steep", "At most steep", 45.0, 1.0, 90.0, "°", 0, "Keeps floors apart"),
                ),
                about="Joins every two of the selected viewpoints that are near enough and see each other: on the "
                "map, or without one by the lists of the file.",
            ),
        ),
    ),
    Operation(
        "mark_reviewed",
        "Mark viewpoints and edges as reviewed",
        _pure(edits.mark_reviewed),
        (*_MARKED, Argument("reviewed", "flag", "false takes it back", True)),
        lambda a: f"Mark {_marked(a)} as {'reviewed' if a['reviewed'] else 'not reviewed'}",
        (
            Offer(
                "reviewed",
                "Mark as re&viewed",
                "You looked at it and found it right",
                4,
                Needs("things"),
                "Y",
                {"reviewed": True},
                marked,
            ),
            Offer(
                "unreviewed",
                "Mark as not reviewed",
                "It should be looked at again",
                4,
                Needs("things"),
                "Shift+Y",
                {"reviewed": False},
                marked,
            ),
        ),
    ),
    Operation(
        "lock",
        "Lock viewpoints and edges against edits",
        _pure(edits.set_locked),
        (*_MARKED, Argument("locked", "flag", "false unlocks", True)),
        lambda a: f"{'Lock' if a['locked'] else 'Unlock'} {_marked(a)}",
        (
            Offer(
                "lock",
                "&Lock",
                "No edit changes or removes it until it is unlocked",
                4,
                Needs("things"),
                "",
                {"locked": True},
                marked,
            ),
            Offer("unlock", "U&nlock", "Edits may change it again", 4, Needs("things"), "", {"locked": False}, marked),
        ),
    ),
    Operation(
        "ignore_finding",
        "Let a finding be, for a reason",
        _pure(edits.ignore_finding),
        (Argument("key", "name", "key of the finding"), Argument("reason", "name", "why")),
        lambda a: "Ignore a finding",
    ),
    Operation(
        "heed_finding",
        "Show an ignored finding again",
        _pure(edits.heed_finding),
        (Argument("key", "name", "key of the finding"),),
        lambda a: "Show a finding again",
    ),
    Operation(
        "together",
        "Several edits as one step",
        _together,
        (Argument("edits", "edits", "in their order"), Argument("text", "name", "words for the history", "")),
        lambda a: a["text"] or counted(len(a["edits"]), "edit"),
    ),
    Operation(
        "patch",
        "Put and take viewpoints and edges as they are given",
        lambda graph, surroundings, text, **parts: edits.patch(graph, **parts),
        (
            Argument("viewpoints", "whole viewpoints", "added, or in the place of those with their ids", ()),
            Argument("edges", "whole edges", "likewise", ()),
            Argument("no_viewpoints", "viewpoints", "ids that go, first of all", ()),
            Argument("no_edges", "edges", "pairs of ids that go, first of all", ()),
            Argument("text", "name", "words for the history", ""),
        ),
        lambda a: a["text"] or "Change the graph",
    ),
)
