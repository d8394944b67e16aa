"""The effect of a click or an area on the selection."""

from __future__ import annotations

from collections.abc import Iterable

from app.modes.mode import ModeContext, Pointer
from nvsim.graph.selection import GraphSelection


def choose(
    context: ModeContext, pointer: Pointer, viewpoints: Iterable[str] = (), edges: Iterable[tuple[str, str]] = ()
) -> None:
    """Selects these items and deselects all others. With Shift, adds them; with Ctrl, toggles them."""
    found = GraphSelection(frozenset(viewpoints), frozenset(edges))
    now = context.editing.selection
    if pointer.toggles:
        found = GraphSelection(now.viewpoints ^ found.viewpoints, now.edges ^ found.edges)
    elif pointer.adds:
        found = GraphSelection(now.viewpoints | found.viewpoints, now.edges | found.edges)
    context.editing.select(found)


def choose_what_is_under(context: ModeContext, pointer: Pointer) -> bool:
    """Selects the viewpoint, or else the edge, under the mouse pointer. Returns False if there is neither and no
    modifier key is pressed."""
    viewpoint = pointer.viewpoint
    if viewpoint is not None:
        choose(context, pointer, [viewpoint])
        return True
    edge = pointer.edge
    if edge is not None:
        choose(context, pointer, edges=[edge])
        return True
    return pointer.adds or pointer.toggles
