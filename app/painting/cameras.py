"""How the eye of the 3D view moves: one pose as a value, and every motion a function pose -> pose.

Orbit and fly share the pose, so that a user may turn around a table and then walk off without switching modes.
Heading and elevation are separate values, so that looking straight down is not a special case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan, atan2, cos, degrees, exp, hypot, log, pi, radians, sin, tan

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look

RADIANS_PER_PIXEL = 0.005
NEAREST_PIVOT = 0.3  # metres
STEEPEST = 40.0  # degrees below the horizon, looking along an edge
FARTHEST_PIVOT = 500.0


@dataclass(frozen=True)
class ViewPose:
    """position   (x, y, z) metres, world
    heading    radians, 0 is +y, positive turns right
    elevation  radians, positive looks up, within [-pi/2, pi/2]
    reach      metres straight ahead to the pivot that an orbit turns about
    fov        vertical field of view, radians
    """

    position: tuple[float, float, float]
    heading: float = 0.0
    elevation: float = 0.0
    reach: float = 3.0
    fov: float = radians(60)

    @property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3), columns are right, down and forward in the world."""
        return look(np.zeros(3), self.heading, self.elevation)[:3, :3]

    @property
    def pivot(self) -> NDArray[np.float64]:
        """(3,) metres, world."""
        return np.asarray(self.position) + self.reach * self.axes[:, 2]

    def camera(self, width: int, height: int) -> Camera:
        """The pinhole of an image of `width` x `height` pixels."""
        focal = height / 2 / tan(self.fov / 2)
        intrinsics = Intrinsics(width, height, focal, focal, width / 2, height / 2)
        return Camera(intrinsics, look(np.asarray(self.position, np.float64), self.heading, self.elevation))


def _at(position: NDArray[np.float64]) -> tuple[float, float, float]:
    return (float(position[0]), float(position[1]), float(position[2]))


def turned(pose: ViewPose, right: float, up: float) -> ViewPose:
    """Looks `right` and `up` radians further, standing still."""
    elevation = min(max(pose.elevation + up, -pi / 2), pi / 2)
    return replace(pose, heading=(pose.heading + right + pi) % (2 * pi) - pi, elevation=elevation)


def orbited(pose: ViewPose, dx: float, dy: float) -> ViewPose:
    """A drag of (dx, dy) pixels turns about the pivot; what is nearer than the pivot follows the cursor."""
    after = turned(pose, dx * RADIANS_PER_PIXEL, -dy * RADIANS_PER_PIXEL)
    return replace(after, position=_at(pose.pivot - pose.reach * after.axes[:, 2]))


def panned(pose: ViewPose, dx: float, dy: float, picture_height: int) -> ViewPose:
    """A drag of (dx, dy) pixels moves sideways; the pivot stays under the cursor."""
    metres = 2 * pose.reach * tan(pose.fov / 2) / picture_height
    axes = pose.axes
    return replace(pose, position=_at(np.asarray(pose.position) - metres * (dx * axes[:, 0] + dy * axes[:, 1])))


def zoomed(pose: ViewPose, factor: float, toward: NDArray[np.float64] | None = None) -> ViewPose:
    """Comes `factor` times as near to the pivot, along `toward` (3,) world where given, so that what is under the
    cursor stays there. Near the pivot it pushes the pivot ahead, so that one can always go on."""
    axes = pose.axes
    step = pose.reach * (1 - factor)
    ray = axes[:, 2]
    if toward is not None and float(toward @ axes[:, 2]) > 0.1:
        ray = toward / float(toward @ axes[:, 2])
    reach = min(max(pose.reach * factor, NEAREST_PIVOT), FARTHEST_PIVOT)
    return replace(pose, position=_at(np.asarray(pose.position) + step * ray), reach=reach)


def flown(pose: ViewPose, forward: float, right: float, up: float) -> ViewPose:
    """Metres along the line of sight, to the right, and along world z."""
    axes = pose.axes
    shift = forward * axes[:, 2] + right * axes[:, 0] + np.array([0.0, 0.0, up])
    return replace(pose, position=_at(np.asarray(pose.position) + shift))


def walked(pose: ViewPose, forward: float, right: float) -> ViewPose:
    """Metres on level ground: ahead by the heading alone, wherever the eye looks up or down to, and to the right."""
    x, y, z = pose.position
    ahead = sin(pose.heading), cos(pose.heading)
    return replace(
        pose, position=(x + forward * ahead[0] + right * ahead[1], y + forward * ahead[1] - right * ahead[0], z)
    )


def seen_from_frame(camera: Camera, reach: float = 3.0) -> ViewPose:
    """Where a frame's camera stood, level, with its vertical field of view."""
    forward = camera.rotation[:, 2]
    heading, elevation = atan2(forward[0], forward[1]), atan2(forward[2], hypot(forward[0], forward[1]))
    fov = 2 * atan(camera.intrinsics.height / 2 / camera.intrinsics.fy)
    return ViewPose(_at(camera.position), heading, elevation, reach, fov)


def top_view(points: NDArray[np.float64], aspect: float = 1.6, fov: float = radians(40)) -> ViewPose:
    """Straight down on all of `points` (N, 3), north up, with a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre = (low + high) / 2
    margin = 2.5  # metres: the walls around those who walked
    half = max((high[1] - low[1]) / 2 + margin, ((high[0] - low[0]) / 2 + margin) / aspect)
    reach = half / tan(fov / 2)
    return ViewPose((float(centre[0]), float(centre[1]), float(high[2]) + reach), 0.0, -pi / 2, reach, fov)


def overview(points: NDArray[np.float64], fov: float = radians(45)) -> ViewPose:
    """All of `points` (N, 3) from a raised corner."""
    low, high = points.min(axis=0), points.max(axis=0)
    # Two metres more: the walls around those who walked.
    reach = (float(np.linalg.norm(high - low)) / 2 + 2.0) / sin(fov / 2)
    pose = ViewPose((0.0, 0.0, 0.0), radians(-25), radians(-42), reach, fov)
    return replace(pose, position=_at((low + high) / 2 - reach * pose.axes[:, 2]))


def focused(pose: ViewPose, point: NDArray[np.float64], reach: float = 3.0) -> ViewPose:
    """Looks at `point` (3,) from `reach` metres, with the direction of view unchanged."""
    return replace(pose, position=_at(point - reach * pose.axes[:, 2]), reach=reach)


def along(pose: ViewPose, eyes: NDArray[np.float64], feet: NDArray[np.float64]) -> ViewPose:
    """Stands at one end of an edge, the one nearer to the eye, and looks down the way to the other: what is in between
    is seen as one who walks sees it. `eyes` and `feet` (2, 3) metres, world, of its ends."""
    near = int(np.linalg.norm(eyes[1] - pose.position) < np.linalg.norm(eyes[0] - pose.position))
    eye, goal = eyes[near], (2 * feet[1 - near] + eyes[1 - near]) / 3
    way = goal - eye
    flat = hypot(way[0], way[1])
    down = max(atan2(way[2], flat), -radians(STEEPEST))
    reach = max(flat, NEAREST_PIVOT)
    return replace(pose, position=_at(eye), heading=atan2(way[0], way[1]), elevation=down, reach=reach)


def between(a: ViewPose, b: ViewPose, share: float) -> ViewPose:
    """The pose at `share` (0 to 1) of the way, by the shorter turn; slow at both ends."""
    t = share * share * (3 - 2 * share)
    turn = (b.heading - a.heading + pi) % (2 * pi) - pi

    def mix(x: float, y: float) -> float:
        return x + (y - x) * t

    x, y, z = (mix(p, q) for p, q in zip(a.position, b.position, strict=True))
    return ViewPose(
        (x, y, z),
        a.heading + turn * t,
        mix(a.elevation, b.elevation),
        exp(mix(log(a.reach), log(b.reach))),
        mix(a.fov, b.fov),
    )


def heading_degrees(pose: ViewPose) -> float:
    """0 to 360, clockwise from +y."""
    return degrees(pose.heading) % 360
