"""The camera of the 3D view: its pose is a value, and every motion is a function from pose to pose.

Orbiting and flying share the pose, so that users can combine them without switching modes. Heading and elevation are
separate values, so that looking straight down is not a special case.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan, atan2, cos, degrees, exp, hypot, log, pi, radians, sin, tan

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose

RADIANS_PER_PIXEL = 0.005
REACH = 3.0  # default distance to the pivot, meters
NEAREST_PIVOT = 0.3  # meters
OVER_WALLS = radians(-50)  # elevation at which a camera above the building looks over walls into its rooms
STEEPEST = 40.0  # maximum angle below the horizon in degrees for a view along an edge
FARTHEST_PIVOT = 500.0  # meters


@dataclass(frozen=True)
class ViewPose:
    """The camera pose of the 3D view.

    position   (x, y, z) meters, world
    heading    radians, 0 is +y, positive turns right
    elevation  radians, positive looks up, within [-pi/2, pi/2]
    reach      distance ahead to the pivot of orbits, meters
    fov        vertical field of view, radians
    """

    position: tuple[float, float, float]
    heading: float = 0.0
    elevation: float = 0.0
    reach: float = REACH
    fov: float = radians(60)

    @property
    def axes(self) -> NDArray[np.float64]:
        """(3, 3), whose columns are right, down, and forward in the world."""
        return camera_pose(np.zeros(3), self.heading, self.elevation)[:3, :3]

    @property
    def pivot(self) -> NDArray[np.float64]:
        """(3,) meters, world."""
        return np.asarray(self.position) + self.reach * self.axes[:, 2]

    def camera(self, width: int, height: int) -> Camera:
        """The pinhole camera of an image of `width` x `height` pixels."""
        focal = height / 2 / tan(self.fov / 2)
        intrinsics = Intrinsics(width, height, focal, focal, width / 2, height / 2)
        return Camera(intrinsics, camera_pose(np.asarray(self.position, np.float64), self.heading, self.elevation))


def _to_tuple(position: NDArray[np.float64]) -> tuple[float, float, float]:
    return (float(position[0]), float(position[1]), float(position[2]))


def turn_pose(pose: ViewPose, right: float, up: float) -> ViewPose:
    """The pose turned by `right` and `up` radians without moving."""
    elevation = min(max(pose.elevation + up, -pi / 2), pi / 2)
    return replace(pose, heading=(pose.heading + right + pi) % (2 * pi) - pi, elevation=elevation)


def orbit_pose(pose: ViewPose, dx: float, dy: float) -> ViewPose:
    """The pose after a drag of (dx, dy) pixels that orbits around the pivot."""
    after = turn_pose(pose, dx * RADIANS_PER_PIXEL, -dy * RADIANS_PER_PIXEL)
    return replace(after, position=_to_tuple(pose.pivot - pose.reach * after.axes[:, 2]))


def pan_pose(pose: ViewPose, dx: float, dy: float, picture_height: int) -> ViewPose:
    """The pose after a drag of (dx, dy) pixels that moves sideways. The pivot stays under the cursor."""
    meters = 2 * pose.reach * tan(pose.fov / 2) / picture_height
    axes = pose.axes
    return replace(pose, position=_to_tuple(np.asarray(pose.position) - meters * (dx * axes[:, 0] + dy * axes[:, 1])))


def zoomed(pose: ViewPose, factor: float, toward: NDArray[np.float64] | None = None) -> ViewPose:
    """The pose after a zoom that multiplies the distance to the pivot by `factor`.

    The camera moves along `toward` ((3,), world) if given, so that the point under the cursor stays there. Near the
    pivot the camera pushes the pivot ahead, so that zooming never stops."""
    axes = pose.axes
    step = pose.reach * (1 - factor)
    ray = axes[:, 2]
    if toward is not None and float(toward @ axes[:, 2]) > 0.1:
        ray = toward / float(toward @ axes[:, 2])
    reach = min(max(pose.reach * factor, NEAREST_PIVOT), FARTHEST_PIVOT)
    return replace(pose, position=_to_tuple(np.asarray(pose.position) + step * ray), reach=reach)


def fly_pose(pose: ViewPose, forward: float, right: float, up: float) -> ViewPose:
    """The pose moved along the optical axis, to the right, and along world z, all in meters."""
    axes = pose.axes
    shift = forward * axes[:, 2] + right * axes[:, 0] + np.array([0.0, 0.0, up])
    return replace(pose, position=_to_tuple(np.asarray(pose.position) + shift))


def walk_pose(pose: ViewPose, forward: float, right: float) -> ViewPose:
    """The pose moved horizontally: along the heading and to the right, in meters. The elevation is ignored."""
    x, y, z = pose.position
    ahead = sin(pose.heading), cos(pose.heading)
    return replace(
        pose, position=(x + forward * ahead[0] + right * ahead[1], y + forward * ahead[1] - right * ahead[0], z)
    )


def seen_from_frame(camera: Camera) -> ViewPose:
    """The pose of a frame's camera without roll, with its vertical field of view."""
    forward = camera.rotation[:, 2]
    heading, elevation = atan2(forward[0], forward[1]), atan2(forward[2], hypot(forward[0], forward[1]))
    fov = 2 * atan(camera.intrinsics.height / 2 / camera.intrinsics.fy)
    return ViewPose(_to_tuple(camera.position), heading, elevation, REACH, fov)


def top_view(points: NDArray[np.float64], aspect: float = 1.6) -> ViewPose:
    """The pose that shows all of `points` (N, 3) in meters, world, from above, north up, with a margin."""
    low, high = points.min(axis=0), points.max(axis=0)
    center = (low + high) / 2
    fov, margin = radians(40), 2.5  # meters, so that walls around the trajectory are visible
    half = max((high[1] - low[1]) / 2 + margin, ((high[0] - low[0]) / 2 + margin) / aspect)
    reach = half / tan(fov / 2)
    return ViewPose((float(center[0]), float(center[1]), float(high[2]) + reach), 0.0, -pi / 2, reach, fov)


def overview(points: NDArray[np.float64]) -> ViewPose:
    """The pose that shows all of `points` (N, 3) in meters, world, from a raised corner."""
    low, high, fov = points.min(axis=0), points.max(axis=0), radians(45)
    # Two meters more, so that walls around the trajectory are visible.
    reach = (float(np.linalg.norm(high - low)) / 2 + 2.0) / sin(fov / 2)
    pose = ViewPose((0.0, 0.0, 0.0), radians(-25), radians(-42), reach, fov)
    return replace(pose, position=_to_tuple((low + high) / 2 - reach * pose.axes[:, 2]))


def focused(pose: ViewPose, point: NDArray[np.float64], reach: float = REACH) -> ViewPose:
    """The pose that looks at `point` (3,) in meters, world, from a distance of `reach` meters without turning."""
    return replace(pose, position=_to_tuple(point - reach * pose.axes[:, 2]), reach=reach)


def view_along_edge(pose: ViewPose, eyes: NDArray[np.float64], feet: NDArray[np.float64]) -> ViewPose:
    """The pose at the nearer end of an edge, looking along the edge to the other end. It shows the obstacles on the
    edge as an agent sees them.

    `eyes` and `feet` (2, 3) are the camera positions and floor points of the two ends, meters, world."""
    near = int(np.linalg.norm(eyes[1] - pose.position) < np.linalg.norm(eyes[0] - pose.position))
    eye, goal = eyes[near], (2 * feet[1 - near] + eyes[1 - near]) / 3
    way = goal - eye
    flat = hypot(way[0], way[1])
    down = max(atan2(way[2], flat), -radians(STEEPEST))
    reach = max(flat, NEAREST_PIVOT)
    return replace(pose, position=_to_tuple(eye), heading=atan2(way[0], way[1]), elevation=down, reach=reach)


def interpolate_poses(a: ViewPose, b: ViewPose, share: float) -> ViewPose:
    """The interpolated pose at `share` (0 to 1), with the shorter turn, slow at both ends."""
    t = share * share * (3 - 2 * share)
    turn = (b.heading - a.heading + pi) % (2 * pi) - pi

    def interpolate(x: float, y: float) -> float:
        return x + (y - x) * t

    x, y, z = (interpolate(p, q) for p, q in zip(a.position, b.position, strict=True))
    return ViewPose(
        (x, y, z),
        a.heading + turn * t,
        interpolate(a.elevation, b.elevation),
        exp(interpolate(log(a.reach), log(b.reach))),
        interpolate(a.fov, b.fov),
    )


def heading_degrees(pose: ViewPose) -> float:
    """The heading in degrees, 0 to 360, clockwise from +y."""
    return degrees(pose.heading) % 360
