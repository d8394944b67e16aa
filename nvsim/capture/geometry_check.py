"""Check the geometry of a capture: outlier cameras, a point cloud in another place, no floor in view.

A single wrong pose some kilometers away would require a map that reaches it. The limit depends on the size of the
trajectory. If the scale is known, the size is the median distance of the cameras from their middle. Otherwise it is the
distance that nine of ten cameras keep, or 20 median steps between frames. (Many robots do not move half of the time, so
the median distance alone may say nothing about the size of a trajectory.)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.alignment import to_aligned_frame
from nvsim.capture.findings import Findings
from nvsim.capture.floor_plane import FloorPlane
from nvsim.capture.types import Capture
from nvsim.geometry.cells import MOST_CELLS

_TIMES = 50.0  # sizes of the trajectory; a camera beyond this distance is too far
_LEAST = 10.0  # meters, the minimum size of a trajectory
_STEPS = 20.0  # median steps between frames, the minimum size of a trajectory without a scale
_LISTED = 20
_NEIGHBORHOOD, _CELL = 24.0, 0.08  # meters: width of a map beyond the trajectory, and its cells of supported floor


def find_far_frames(capture: Capture) -> NDArray[np.bool_]:
    """(N,) bool, True for frames whose camera is farther than 50 times the size of the trajectory from its middle."""
    positions = capture.positions
    if len(positions) < 3:
        return np.zeros(len(positions), bool)
    afar = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    if capture.alignment.scale_known:
        size = max(float(np.median(afar)), _LEAST)
    else:
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        size = max(float(np.quantile(afar, 0.9)), _STEPS * float(np.median(steps)))
    return np.asarray((afar > _TIMES * size) & (size > 0))


def check_far_frames(capture: Capture, where: Mapping[str, str], findings: Findings) -> bool:
    """Whether all frames are near enough to each other for one map.

    Otherwise an error finding names the frames that are far from the trajectory, and the option that removes them. A
    trajectory that is wider than any map also gives an error finding. `where` maps frame names to file and line."""
    positions = capture.positions
    far = find_far_frames(capture)
    if far.any():
        frames = [f for f, is_far in zip(capture.frames, far, strict=True) if is_far]
        distance = float(np.linalg.norm(positions[far] - np.median(positions, axis=0), axis=1).max())
        names = ",".join(f.name for f in frames[:_LISTED]) + (",..." if len(frames) > _LISTED else "")
        plural = "s are" if len(frames) > 1 else " is"
        findings.error(
            f"{len(frames)} camera{plural} up to {distance:.4g} away from the trajectory; correct the pose or give "
            f"--leave-out {names}",
            ", ".join(where[f.name] for f in frames[:_LISTED]),
            "the map would have to reach these cameras, which exceeds any memory",
            tuple(f.name for f in frames),
        )
        return False
    if capture.alignment.scale_known and len(positions):
        x, y = np.ptp(positions[:, :2], axis=0)
        if (x + _NEIGHBORHOOD) * (y + _NEIGHBORHOOD) > MOST_CELLS * _CELL**2:
            findings.error(
                f"the cameras span {x:.4g} x {y:.4g} m, more than a map can hold",
                capture.source.name,
                f"a map has at most {MOST_CELLS * _CELL**2 / 1e6:.2g} square kilometers; correct the "
                "scale, import a part, or remove frames with --leave-out",
            )
            return False
    return True


_LONE = 20.0  # times the median distance between neighboring cameras
_AFAR = 3.0  # times the distance from the middle that nine of ten cameras keep
_LOOKED_AT = 200  # cameras, evenly chosen
_SAMPLE = 20_000  # points of the cloud
_ON_IT = 0.2  # of its distance: an object captured from all sides is this near to the viewing axes of the cameras
_AROUND = 0.7  # mean length of the directions from an object to its cameras; 0 all around it, 0.9 from a quarter circle
_LOOKS_DOWN = 0.12  # minimum downward slope of a ray; such a ray meets the floor within 8 camera heights


def check_outliers(capture: Capture, where: Mapping[str, str], findings: Findings) -> None:
    """Add a warning for each camera that is upside down, or isolated and far from the trajectory.

    `where` maps frame names to file and line."""
    from scipy.spatial import cKDTree

    positions = capture.positions
    ups = np.array([-f.camera_to_world[2, 1] for f in capture.frames])
    for i in np.flatnonzero(ups < -0.2):
        findings.warning(
            "the camera is upside down",
            where[capture.frames[i].name],
            "its pose is wrong, or the image is rotated; the frame would degrade its submap",
        )
    if len(positions) < 8:
        return
    distinct = np.unique(positions, axis=0)
    if len(distinct) < 8:
        return
    tree = cKDTree(distinct)
    # The second neighbor is used because two outliers may be close to each other.
    alone = tree.query(positions, k=3)[0][:, 2]
    afar = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    lost = (alone > _LONE * np.median(alone)) & (afar > _AFAR * np.quantile(afar, 0.9))
    for i in np.flatnonzero(lost):
        findings.warning(
            f"the camera is an outlier, {alone[i]:.1f} from the next ones",
            where[capture.frames[i].name],
            f"the scene would extend to this camera; if its pose is wrong, --leave-out {capture.frames[i].name}",
        )


def check_cloud_meets_cameras(capture: Capture, findings: Findings) -> bool:
    """Whether the point cloud is where the cameras look; otherwise adds an error finding.

    Without a point cloud the result is True, with a warning unless depth images provide one."""
    cloud = capture.cloud
    place = capture.source.name
    if capture.has_measured_depth and (cloud is None or not len(cloud.points)):
        return True
    if cloud is None or not len(cloud.points):
        findings.warning(
            "there is no point cloud",
            place,
            "depth estimated from the images replaces it, and surfaces without texture are missing",
        )
        return True
    points = cloud.points[:: max(1, len(cloud.points) // _SAMPLE)].astype(np.float64)
    seen = []
    for frame in capture.frames[:: max(1, len(capture.frames) // _LOOKED_AT)]:
        pixels, depth = frame.camera.project(points)
        size = np.array([frame.intrinsics.width, frame.intrinsics.height])
        seen.append(np.count_nonzero((depth > 0) & (pixels >= 0).all(axis=1) & (pixels < size).all(axis=1)))
    share = float(np.mean(np.array(seen) >= max(3, 2e-4 * len(points))))
    walked = float(np.linalg.norm(np.ptp(np.quantile(capture.positions, [0.05, 0.95], axis=0), axis=0)))
    extent = float(np.linalg.norm(np.ptp(np.quantile(points, [0.05, 0.95], axis=0), axis=0)))
    gaps = np.linalg.norm(points[None, ::20] - capture.positions[:: max(1, len(capture.frames) // 50), None], axis=2)
    gap = float(np.median(gaps.min(axis=1)))
    if share < 0.5 or extent < 0.05 * walked or gap > max(3 * walked, 15.0 if capture.alignment.scale_known else 0.0):
        findings.error(
            f"the point cloud does not match the cameras: {share:.0%} of them see it, it is {extent:.3g} wide for a "
            f"trajectory of {walked:.3g}, and {gap:.3g} away",
            place,
            "the point cloud has another frame or unit; floor heights and trained models would be wrong",
        )
        return False
    return True


def check_surroundings(capture: Capture, findings: Findings) -> None:
    """Add a warning if the cameras surround an object and all look at it, so that the images show no building."""
    poses = np.array([f.camera_to_world for f in capture.frames])
    if len(poses) < 8:
        return
    centers, axes = poses[:, :3, 3], poses[:, :3, 2]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    target = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, centers), rcond=None)[0]
    to_target = target - centers
    distance = np.maximum(np.linalg.norm(to_target, axis=1), 1e-9)
    off = np.linalg.norm(np.einsum("nij,nj->ni", across, to_target), axis=1) / distance
    is_seen = (off < _ON_IT) & (np.einsum("ni,ni->n", axes, to_target) > 0)
    around = float(np.linalg.norm((to_target[:, :2] / distance[:, None]).mean(axis=0)))
    if np.mean(is_seen) > 0.9 and around < _AROUND:
        findings.warning(
            f"{np.count_nonzero(is_seen)} of {len(poses)} cameras surround one object and look at it",
            capture.source.name,
            "most of the room is in no image, and a table under the object may be mistaken for the floor; for "
            "navigation, walk through the rooms and look in the direction of travel",
        )


def check_floor_in_view(capture: Capture, floor: FloorPlane | None, findings: Findings) -> None:
    """Add a warning if the point cloud has no floor below the cameras, or if few cameras look down at the floor."""
    place = capture.source.name
    if floor is None and capture.cloud is not None and len(capture.cloud.points):
        findings.warning(
            "the point cloud has no floor below the cameras", place, "floor heights come from the camera height alone"
        )
    downwards = [_looks_down(capture, i) for i in range(len(capture.frames))]
    if np.mean(downwards) < 0.1:
        findings.warning(
            f"no floor in view: {np.count_nonzero(downwards)} of {len(downwards)} cameras look down far enough",
            place,
            "floor that no image shows is unknown and never traversable",
        )
        return
    if floor is None or capture.cloud is None:
        return
    points = to_floor_points(capture, floor)
    if not len(points):
        return
    sees = []
    for frame in capture.frames[:: max(1, len(capture.frames) // _LOOKED_AT)]:
        pixels, depth = frame.camera.project(points)
        size = np.array([frame.intrinsics.width, frame.intrinsics.height])
        sees.append(bool(((depth > 0) & (pixels >= 0).all(axis=1) & (pixels < size).all(axis=1)).any()))
    if np.mean(sees) < 0.1:
        findings.warning(
            f"no floor in view: {np.count_nonzero(sees)} of {len(sees)} cameras see the floor of the point cloud",
            place,
            "floor that no image shows is unknown and never traversable",
        )


def to_floor_points(capture: Capture, floor: FloorPlane) -> np.ndarray:
    """(K, 3) float64 points of the point cloud that are on the floor plane, meters, aligned frame; a sample.

    `floor` is in source coordinates after subtraction of the alignment's origin."""
    assert capture.cloud is not None
    points = capture.cloud.points[:: max(1, len(capture.cloud.points) // _SAMPLE)].astype(np.float64)
    normal = capture.alignment.rotation @ floor.normal
    anchor = to_aligned_frame(floor.normal * floor.offset + capture.alignment.origin, capture.alignment)
    tolerance = 0.05 * float(np.median((capture.positions - anchor) @ normal))
    return np.asarray(points[np.abs((points - anchor) @ normal) < tolerance])


def _looks_down(capture: Capture, index: int) -> bool:
    """Whether at least three of 27 rays through the top, middle, and bottom rows of the image look down steeply."""
    frame = capture.frames[index]
    k = frame.intrinsics
    u = np.linspace(0, k.width, 9)
    edges = np.concatenate([np.stack([u, np.full(9, v)], axis=1) for v in (0.0, k.height / 2, float(k.height))])
    rays = np.stack([(edges[:, 0] - k.cx) / k.fx, (edges[:, 1] - k.cy) / k.fy, np.ones(27)], axis=1)
    slopes = (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ frame.camera_to_world[2, :3]
    return bool(np.count_nonzero(slopes < -_LOOKS_DOWN) >= 3)
