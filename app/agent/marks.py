"""Where the navigable locations lie in the agent's image. Knows no widgets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.agent.state import AgentState
from app.painting.picking import NEAR
from nvsim.geometry.view_sweep import HEIGHT, WIDTH

MARGIN = 16.0  # pixels from the rim to the middle of a mark, which is seen whole
_WITHIN = 0.5  # pixels from the rim; looking up or down, what is level lies on it


@dataclass(frozen=True)
class Mark:
    """index     in navigableLocations
    x, y      pixels of the 640 x 480 image: where the viewpoint's camera is, or by the rim where that is beyond it
    inside    whether it is in the image
    foot      pixels of its foot on the floor, None where that is behind the camera
    distance  metres
    """

    index: int
    viewpoint: str
    x: float
    y: float
    inside: bool
    foot: tuple[float, float] | None
    distance: float


def marks(state: AgentState, feet: Mapping[str, NDArray[np.float64]]) -> tuple[Mark, ...]:
    """The navigable locations but the first, far ones first, so that near ones are drawn over them. `feet` are (3,)
    metres, world, by viewpoint id."""
    camera, found = state.camera, []
    for index, place in enumerate(state.navigableLocations[1:], 1):
        eye = np.array([place.x, place.y, place.z])
        pixels, depths = camera.project(np.stack([eye, feet.get(place.viewpointId, eye)]))
        (x, y), foot = pixels[0].tolist(), pixels[1].tolist()
        inside = bool(depths[0] > NEAR and _WITHIN <= x <= WIDTH - _WITHIN and _WITHIN <= y <= HEIGHT - _WITHIN)
        if depths[0] <= NEAR:  # beside or behind: at the side to turn to
            x = WIDTH if place.rel_heading > 0 else 0.0
            y = HEIGHT / 2
        found.append(
            Mark(
                index,
                place.viewpointId,
                min(max(x, MARGIN), WIDTH - MARGIN),
                min(max(y, MARGIN), HEIGHT - MARGIN),
                inside,
                (foot[0], foot[1]) if inside and depths[1] > NEAR else None,
                place.rel_distance,
            )
        )
    return tuple(sorted(found, key=lambda mark: -mark.distance))
