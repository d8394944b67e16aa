"""The positions of the navigable locations in the agent's image. Does not use Qt."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.agent.state import AgentState
from app.painting.picking import NEAR
from nvsim.geometry.directions import HEIGHT, WIDTH

MARGIN = 16.0  # pixels from the image border to the center of a mark, so that the whole mark is visible
_APART = 24.0  # pixels between two marks
_WITHIN = 0.5  # pixels from the image border; if the agent looks up or down, level locations are on the border


@dataclass(frozen=True)
class Mark:
    """The mark of one navigable location.

    index     index in navigableLocations
    x, y      pixels of the 640 x 480 image: the viewpoint's camera, moved to the border if it is outside the image
    inside    whether the viewpoint's camera is in the image
    foot      pixels of the point on the floor below it; None if `inside` is false or the point is behind the camera
    distance  meters
    """

    index: int
    viewpoint: str
    x: float
    y: float
    inside: bool
    foot: tuple[float, float] | None
    distance: float


def marks(state: AgentState, feet: Mapping[str, NDArray[np.float64]]) -> tuple[Mark, ...]:
    """The marks of all navigable locations except the first, farthest first, so that near marks are drawn on top.
    `feet` maps viewpoint ids to floor points (3,) in meters, world."""
    placed: list[Mark] = []
    for mark in sorted(_marks(state, feet), key=lambda mark: mark.distance):
        up = -1 if mark.y >= HEIGHT / 3 else 1
        while any(abs(mark.x - other.x) < _APART and abs(mark.y - other.y) < _APART for other in placed):
            mark = replace(mark, y=mark.y + up * _APART)
        placed.append(mark)
    return tuple(reversed(placed))


def _marks(state: AgentState, feet: Mapping[str, NDArray[np.float64]]) -> Iterator[Mark]:
    camera = state.camera
    for index, place in enumerate(state.navigableLocations[1:], 1):
        eye = np.array([place.x, place.y, place.z])
        pixels, depths = camera.project(np.stack([eye, feet.get(place.viewpointId, eye)]))
        (x, y), foot = pixels[0].tolist(), pixels[1].tolist()
        ahead = bool(depths[0] > NEAR)
        inside = ahead and _WITHIN <= x <= WIDTH - _WITHIN and _WITHIN <= y <= HEIGHT - _WITHIN
        if not ahead:  # beside or behind the agent: at the side to which the agent must turn
            x, y = (WIDTH if place.rel_heading > 0 else 0.0), HEIGHT / 2
        yield Mark(
            index,
            place.viewpointId,
            min(max(x, MARGIN), WIDTH - MARGIN),
            min(max(y, MARGIN), HEIGHT - MARGIN),
            inside,
            (foot[0], foot[1]) if inside and depths[1] > NEAR else None,
            place.rel_distance,
        )
