"""What the geometry of a capture shows: cameras far from all others, a cloud elsewhere, no floor to be seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nvsim.capture.alignment import to_aligned_frame
from nvsim.capture.findings import Findings
from nvsim.capture.floor_plane import FloorPlane
from nvsim.capture.types import Capture

_LONE = 20.0  # times the median distance between neighbouring cameras
_AFAR = 3.0  # times the distance from the middle that nine of ten cameras keep
_LOOKED_AT = 200  # cameras, evenly chosen
_SAMPLE = 20_000  # points of the cloud
_LOOKS_DOWN = 0.12  # slope of a ray that meets the floor before 13 times the camera's height


def check_outliers(capture: Capture, where: Mapping[str, str], findings: Findings) -> None:
    """Warns of each camera that stands alone and far from the trajectory, or hangs upside down. `where`: places by
    name."""
    from scipy.spatial import cKDTree

    positions = capture.positions
    ups = np.array([-f.camera_to_world[2, 1] for f in capture.frames])
    for i in np.flatnonzero(ups < -0.2):
        findings.warning(
            "the camera is upside down",
            where[capture.frames[i].name],
            "its pose is wrong, or the image is turned; it would spoil its submap",
        )
    if len(positions) < 8:
        return
    distinct = np.unique(positions, axis=0)
    if len(distinct) < 8:
        return
    tree = cKDTree(distinct)
    # The second neighbour: two lost cameras may lie side by side.
    alone = tree.query(positions, k=3)[0][:, 2]
    afar = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    lost = (alone > _LONE * np.median(alone)) & (afar > _AFAR * np.quantile(afar, 0.9))
    for i in np.flatnonzero(lost):
        findings.warning(
            f"the camera is an outlier, {alone[i]:.1f} from the next ones",
            where[capture.frames[i].name],
            f"the scene would be stretched to reach it; if its pose is wrong, --leave-out {capture.frames[i].name}",
        )


def check_cloud_meets_cameras(capture: Capture, findings: Findings) -> bool:
    """Whether the cloud lies where the cameras look; otherwise an error finding. Without a cloud it is True, and a
    warning unless depth images make one."""
    cloud = capture.cloud
    place = capture.source.name
    if capture.has_measured_depth and (cloud is None or not len(cloud.points)):
        return True
    if cloud is None or not len(cloud.points):
        findings.warning(
            "there is no point cloud",
            place,
            "the depth of the images stands in for it, which misses what has no texture",
        )
        return True
    points = cloud.points[:: max(1, len(cloud.points) // _SAMPLE)].astype(np.float64)
    seen = []
    for frame in capture.frames[:: max(1, len(capture.frames) // _LOOKED_AT)]:
        pixels, depth = frame.camera.project(points)
        size = np.array([frame.lens.width, frame.lens.height])
        seen.append(np.count_nonzero((depth > 0) & (pixels >= 0).all(axis=1) & (pixels < size).all(axis=1)))
    share = float(np.mean(np.array(seen) >= max(3, 2e-4 * len(points))))
    walked = float(np.linalg.norm(np.ptp(np.quantile(capture.positions, [0.05, 0.95], axis=0), axis=0)))
    extent = float(np.linalg.norm(np.ptp(np.quantile(points, [0.05, 0.95], axis=0), axis=0)))
    gaps = np.linalg.norm(points[None, ::20] - capture.positions[:: max(1, len(capture.frames) // 50), None], axis=2)
    gap = float(np.median(gaps.min(axis=1)))
    if share < 0.5 or extent < 0.05 * walked or gap > max(3 * walked, 15.0 if capture.alignment.scale_known else 0.0):
        findings.error(
            f"the cloud does not meet the cameras: {share:.0%} of them look at it, it is {extent:.3g} wide beside a "
            f"trajectory of {walked:.3g}, and {gap:.3g} away",
            place,
            "the cloud is in another frame or unit; floor heights and the models would be wrong",
        )
        return False
    return True


def check_floor_in_view(capture: Capture, floor: FloorPlane | None, findings: Findings) -> None:
    """Warns when the cloud has no floor below the cameras, and when few cameras look down at where a floor would be."""
    place = capture.source.name
    if floor is None and capture.cloud is not None and len(capture.cloud.points):
        findings.warning(
            "the cloud has no floor below the cameras", place, "floor heights follow from the camera height alone"
        )
    downwards = [_looks_down(capture, i) for i in range(len(capture.frames))]
    if np.mean(downwards) < 0.1:
        findings.warning(
            f"no floor in view: {np.count_nonzero(downwards)} of {len(downwards)} cameras look down far enough",
            place,
            "floor that no image shows is unknown, and the map never walks on it",
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
        size = np.array([frame.lens.width, frame.lens.height])
        sees.append(bool(((depth > 0) & (pixels >= 0).all(axis=1) & (pixels < size).all(axis=1)).any()))
    if np.mean(sees) < 0.1:
        findings.warning(
            f"no floor in view: {np.count_nonzero(sees)} of {len(sees)} cameras look at floor that the cloud shows",
            place,
            "floor that no image shows is unknown, and the map never walks on it",
        )


def to_floor_points(capture: Capture, floor: FloorPlane) -> np.ndarray:
    """Points (K, 3) of the cloud on the plane, aligned frame; a sample. `floor` is of the source's coordinates
    without the origin of the alignment."""
    assert capture.cloud is not None
    points = capture.cloud.points[:: max(1, len(capture.cloud.points) // _SAMPLE)].astype(np.float64)
    normal = capture.alignment.rotation @ floor.normal
    anchor = to_aligned_frame(floor.normal * floor.offset + capture.alignment.origin, capture.alignment)
    tolerance = 0.05 * float(np.median((capture.positions - anchor) @ normal))
    return np.asarray(points[np.abs((points - anchor) @ normal) < tolerance])


def _looks_down(capture: Capture, index: int) -> bool:
    """Whether a quarter of the image's lower edge, or its centre, looks down steeply enough."""
    frame = capture.frames[index]
    k = frame.intrinsics
    u = np.linspace(0, k.width, 9)
    edges = np.concatenate([np.stack([u, np.full(9, v)], axis=1) for v in (0.0, k.height / 2, float(k.height))])
    rays = np.stack([(edges[:, 0] - k.cx) / k.fx, (edges[:, 1] - k.cy) / k.fy, np.ones(27)], axis=1)
    slopes = (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ frame.camera_to_world[2, :3]
    return bool(np.count_nonzero(slopes < -_LOOKS_DOWN) >= 3)
