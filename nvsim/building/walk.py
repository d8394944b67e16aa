"""The trajectory of a robot along the stops of a plan: rounded corners, turns in place, an image per step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.building.plan import GOING, LENGTH, Flight, TrajectoryCorner

_CORNER = 0.6  # meters before a corner where the turn begins
_LOOKING_DOWN = np.radians(20)
_NODDING = 0.8  # meters of the stairs over which the camera turns down and up again
_SHARPEST = np.radians(125)  # beyond this angle the robot stops and turns in place


def _heading(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.arctan2(b[0] - a[0], b[1] - a[1]))


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def path(stops: tuple[TrajectoryCorner, ...]) -> NDArray[np.float64]:
    """(N, 3) x, y and unwrapped heading (0 is +y, clockwise), meters and radians, every centimeter or half degree."""
    points = [np.array([s.x, s.y]) for s in stops]
    spins = [s.turns_in_place for s in stops]
    kept = [0] + [i for i in range(1, len(points)) if np.linalg.norm(points[i] - points[i - 1]) > 0.02]
    points, spins = [points[i] for i in kept], [spins[i] for i in kept]
    heading = _heading(points[0], points[1])
    pieces = [np.array([[*points[0], heading]])]
    here = points[0]
    for i in range(1, len(points) - 1):
        before, corner, after = points[i - 1], points[i], points[i + 1]
        turn = _wrapped(_heading(corner, after) - heading)
        in_place = spins[i] or abs(turn) > _SHARPEST
        if spins[i]:
            turn -= 2 * np.pi * (1 if turn > 0 else -1)
        lengths = float(np.linalg.norm(corner - before)), float(np.linalg.norm(after - corner))
        cut = 0.0 if in_place or abs(turn) < 0.02 else min(_CORNER, 0.48 * lengths[0], 0.48 * lengths[1])
        towards = np.array([np.sin(heading), np.cos(heading)])
        pieces.append(_straight(here, corner - cut * towards, heading))
        if in_place:
            count = max(2, int(np.ceil(abs(turn) / np.radians(0.5))))
            angles = heading + turn * np.arange(1, count + 1) / count
            pieces.append(np.column_stack([np.tile(corner, (count, 1)), angles]))
            here = corner
        elif cut > 0:
            outward = (after - corner) / lengths[1]
            pieces.append(_bend(corner - cut * towards, corner, corner + cut * outward, heading))
            here = corner + cut * outward
        else:
            here = corner
        heading += turn
    pieces.append(_straight(here, points[-1], heading))
    return np.concatenate(pieces)


def _straight(a: NDArray[np.float64], b: NDArray[np.float64], heading: float) -> NDArray[np.float64]:
    count = max(1, int(np.ceil(np.linalg.norm(b - a) / 0.01)))
    s = np.arange(1, count + 1)[:, None] / count
    return np.column_stack([a + s * (b - a), np.full(count, heading)])


def _bend(
    a: NDArray[np.float64], corner: NDArray[np.float64], b: NDArray[np.float64], heading: float
) -> NDArray[np.float64]:
    """A quadratic Bezier curve about the corner, heading along its tangent."""
    s = np.arange(1, 161)[:, None] / 160
    xy = (1 - s) ** 2 * a + 2 * s * (1 - s) * corner + s**2 * b
    tangent = (1 - s) * (corner - a) + s * (b - corner)
    angles = np.unwrap(np.concatenate([[heading], np.arctan2(tangent[:, 0], tangent[:, 1])]))[1:]
    return np.column_stack([xy, angles])


def with_floor_heights(dense: NDArray[np.float64], flight: Flight | None) -> NDArray[np.float64]:
    """(N, 5) a path (N, 3) with the height of the floor under it, meters, and the elevation of the camera, radians. The
    path begins on the lowest floor and changes storeys on the flight. On the way down the camera looks down."""
    floor, elevation = np.zeros(len(dense)), np.zeros(len(dense))
    if flight is not None:
        ahead = flight.along(dense[:, :2])
        beside = np.linalg.norm(dense[:, :2] - flight.foot - np.outer(ahead, flight.direction), axis=1)
        on = (beside < flight.width / 2) & (ahead > -GOING / 2) & (ahead < LENGTH + GOING / 2)
        floor[on] = flight.height_at(dense[on, :2])
        up = False
        for i in range(len(dense)):
            if on[i]:
                up = ahead[i] > LENGTH / 2
            elif up:
                floor[i] = flight.climb
        down = on & (np.gradient(floor) < 0)
        elevation[down] = -_LOOKING_DOWN * np.clip(np.minimum(ahead, LENGTH - ahead)[down] / _NODDING, 0, 1)
    return np.column_stack([dense, floor, elevation])


def frames(dense: NDArray[np.float64], step: float, turn: float) -> NDArray[np.float64]:
    """The samples (M, 5) of a path (N, 5) at which an image is recorded: `step` meters or `turn` radians apart, or an
    equal amount of both combined. Rounded to a micrometer, so that every machine agrees."""
    moved = np.linalg.norm(np.diff(dense[:, :2], axis=0), axis=1) / step
    turned = np.diff(dense[:, 2]) / turn
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(moved, turned))])
    chosen = np.searchsorted(np.round(travelled, 6), np.arange(int(travelled[-1]) + 1))
    return np.round(dense[np.minimum(chosen, len(dense) - 1)], 6)
