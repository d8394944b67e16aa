"""Finds for each neighbor of a viewpoint the one of the 36 views that shows it best, and its place in that view.

This is the closed form of the sweep that VLN-DUET, HAMT and Recurrent-VLN-BERT do with Matterport3DSimulator at 640x480
and 60 degrees. A view shows the neighbors within 40 degrees of its heading. This is the simulator's restricted
navigation, whose field of view grows linearly with the width. If several views show a neighbor, the view with the
smallest sqrt(heading² + elevation²) is selected, with both angles measured from the view's axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.view_sweep import HEIGHT, VFOV, VIEWS, WIDTH, heading_and_elevation

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

TIE = 1e-5
"""Radians. If the angles of two views differ by less, the lowest viewIndex is selected, as in exact arithmetic with the
agents' strict comparison. The simulator computes in 32 bits, so its choice in such ties depends on rounding."""
_SEEN = VFOV * WIDTH / HEIGHT / 2
HEADINGS, ELEVATIONS = np.array([heading_and_elevation(view) for view in range(VIEWS)]).T
"""(36,) radians, heading and elevation of the views, by viewIndex."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """The neighbors that the sweeps show, in the order of the sweep.

    They are sorted by viewpoint, then by the first view that shows them, then by the angle from that view's axis.

    source, target             (m,) indices of viewpoints
    view                       (m,) viewIndex, called "pointId" by the agents
    angle                      (m,) radians, sqrt(rel_heading² + rel_elevation²)
    rel_heading, rel_elevation (m,) radians from the view's axis; right and up are positive
    heading, elevation         (m,) radians, world: 0 is +y; heading is the view's plus rel_heading, from -15 to 345
                               degrees
    distance                   (m,) meters
    unseen                     (k, 2) edges that no sweep shows: straight up, straight down, or of zero length
    """

    source: Int64
    target: Int64
    view: Int64
    angle: Float64
    rel_heading: Float64
    rel_elevation: Float64
    heading: Float64
    elevation: Float64
    distance: Float64
    unseen: Int64


def candidates_of(positions: Float64, edges: Int64) -> Candidates:
    """Computes the candidates of directed `edges` (m, 2), indices of `positions` (n, 3), meters, world."""
    way = positions[edges[:, 1]] - positions[edges[:, 0]]
    level = np.hypot(way[:, 0], way[:, 1])
    unseen, edges = edges[level == 0], edges[level > 0]
    way, level = way[level > 0], level[level > 0]
    heading = np.arctan2(way[:, 0], way[:, 1])
    elevation = np.arctan2(way[:, 2], level)
    rel_heading = np.pi - np.mod(np.pi - (heading[:, None] - HEADINGS), 2 * np.pi)  # (m, 36), in (-pi, pi]
    rel_elevation = elevation[:, None] - ELEVATIONS
    shown = np.abs(rel_heading) <= _SEEN
    angle = np.hypot(rel_heading, rel_elevation)
    best = np.where(shown, angle, np.inf).min(axis=1, keepdims=True, initial=np.inf)
    view = np.argmax(shown & (angle <= best + TIE), axis=1)
    each = np.arange(len(edges))
    first = np.argmax(shown, axis=1)
    met = np.lexsort((edges[:, 1], np.rint(angle[each, first] / TIE), first, edges[:, 0]))
    each, view, edges = each[met], view[met], edges[met]
    return Candidates(
        source=edges[:, 0],
        target=edges[:, 1],
        view=view,
        angle=angle[each, view],
        rel_heading=rel_heading[each, view],
        rel_elevation=rel_elevation[each, view],
        heading=HEADINGS[view] + rel_heading[each, view],
        elevation=elevation[met],
        distance=np.linalg.norm(way[met], axis=1),
        unseen=unseen,
    )
