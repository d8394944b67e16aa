"""Edits of the graph: each is one function from a graph to a graph. Edits do not use files or the history.

Elements that a user adds or moves get the origin "person". Every edit raises EditError, one sentence, if the graph does
not allow it. It returns the given graph object if nothing changes.
"""

from nvsim.graph.edits.change import Change, EditError
from nvsim.graph.edits.edges import (
    Visible,
    add_edge,
    add_edges,
    connect_visible,
    heed_finding,
    ignore_finding,
    mark_reviewed,
    remove_edge,
    remove_edges,
    set_locked,
)
from nvsim.graph.edits.moving import (
    align_to_lattice,
    chain,
    move_viewpoint,
    move_viewpoints,
    set_height,
    shift_viewpoints,
    straighten,
)
from nvsim.graph.edits.viewpoints import (
    add_viewpoint,
    copy_by,
    merge_viewpoints,
    nearest_trajectory_position,
    new_id,
    patch,
    place_viewpoint,
    remove_viewpoints,
    rename_viewpoint,
    set_included,
    split_edge,
)

__all__ = [
    "Change",
    "EditError",
    "Visible",
    "add_edge",
    "add_edges",
    "add_viewpoint",
    "align_to_lattice",
    "chain",
    "connect_visible",
    "copy_by",
    "heed_finding",
    "ignore_finding",
    "mark_reviewed",
    "merge_viewpoints",
    "move_viewpoint",
    "move_viewpoints",
    "new_id",
    "patch",
    "place_viewpoint",
    "remove_edge",
    "remove_edges",
    "remove_viewpoints",
    "rename_viewpoint",
    "set_height",
    "set_included",
    "set_locked",
    "shift_viewpoints",
    "nearest_trajectory_position",
    "split_edge",
    "straighten",
]
