"""From the frame of the files to the aligned one: z up by the smallest rotation about the origin, scale kept apart.
(`origin.py` takes the origin off first if the coordinates are far from it.)

Up comes from the cameras (people and robots hold them level on average) and is refined by the dominant floor plane of
the cloud, or if it shows no floor, of depth images or of what the images show themselves. A capture whose up is within
2 degrees of z is not touched.

The scale is known when the user gives it, when the source claims metres and its cameras are at a height above the
floor that a user or a robot can have, or when the user gives that height.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.depth_images import depth_points
from nvsim.capture.findings import Findings
from nvsim.capture.floor_plane import FloorPlane, find_floor
from nvsim.capture.image_points import image_points
from nvsim.capture.raw import RawCapture
from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.errors import InputError
from nvsim.geometry.rotation import smallest_rotation

UNTOUCHED_DEGREES = 2.0
PLAUSIBLE_HEIGHT = (0.1, 6.0)  # metres of a camera above the floor: from a vacuum robot's to a raised pole's
_UNSURE_DEGREES = 20.0  # of an up that all cameras together may lean away from
_Z = np.array([0.0, 0.0, 1.0])


def find_up(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """(3,) unit vector from camera-to-world poses (N, 4, 4), N > 0, and how many degrees it may be off.

    The geometric median of the cameras' up-vectors, so that a few cameras mounted on their side do not count. Where the
    cameras look in several directions, the direction that their right-vectors are most nearly perpendicular to is
    better, because it does not lean when all cameras look down; it is used when it agrees within 40 degrees.
    """
    ups, rights = -poses[:, :3, 1], poses[:, :3, 0]
    median = ups.mean(axis=0)
    for _ in range(30):  # Weiszfeld's iteration
        weights = 1 / np.maximum(np.linalg.norm(ups - median, axis=1), 1e-6)
        median = (weights[:, None] * ups).sum(axis=0) / weights.sum()
    length = float(np.linalg.norm(median))
    if length < 1e-6:
        return _Z.copy(), _UNSURE_DEGREES
    up, unsure = median / length, _UNSURE_DEGREES
    upright = rights[ups @ up > 0.5]
    if len(upright) >= 3:
        values, vectors = np.linalg.eigh(upright.T @ upright / len(upright))
        level = vectors[:, 0] * np.sign(vectors[:, 0] @ up)
        if values[1] > 0.05 and values[1] > 5 * values[0] and level @ up > np.cos(np.radians(40)):
            up, unsure = level, float(np.clip(1.5 * np.degrees(np.sqrt(max(values[0], 0.0))), 1.5, 12.0))
    return np.asarray(up / np.linalg.norm(up)), unsure


def align(
    raw: RawCapture, scale: float | None, camera_height: float | None, findings: Findings
) -> tuple[Alignment, FloorPlane | None]:
    """The alignment of a capture and the floor plane that it rests on (source frame and unit), None where neither the
    cloud nor the images show one. Raises InputError when `scale` or `camera_height` is not positive or cannot be
    applied."""
    for value, name in ((scale, "scale"), (camera_height, "camera height")):
        if value is not None and not (np.isfinite(value) and 0 < value < 1e6):
            raise InputError(f"The {name} {value:g} is not a positive number of metres; give one like 1.2.")
    poses = np.array([f.camera_to_world for f in raw.frames if f.camera_to_world is not None])
    if not len(poses):
        return Alignment(np.eye(3), scale or 1.0, scale is not None, raw.origin), None
    up, unsure = find_up(poses)
    positions = poses[:, :3, 3]
    floor = None if raw.cloud is None else find_floor(raw.cloud.points, positions, up, unsure)
    seen_in = "the cloud"
    if floor is None and raw.depths:
        floor, seen_in = find_floor(depth_points(raw.depths), positions, up, unsure), "the depth images"
    if floor is None and (raw.cloud is None or not raw.cloud.is_dense):
        floor, seen_in = find_floor(image_points(raw.frames), positions, up, unsure), "the images"
    if floor is not None:
        up = floor.normal
    tilt = float(np.degrees(np.arccos(np.clip(up[2], -1, 1))))
    if tilt <= UNTOUCHED_DEGREES:
        rotation = np.eye(3)
    else:
        rotation = smallest_rotation(up, _Z)
        basis = f"the cameras and the floor of {seen_in}" if floor is not None else "the cameras alone"
        findings.note(
            f"up is {tilt:.1f} degrees away from z, judged from {basis}",
            raw.source.name,
            "the capture is turned about the origin so that z is up; exports can undo it",
        )
    units, known = _scale(raw, positions, floor, scale, camera_height, findings)
    return Alignment(rotation, units, known, raw.origin), floor


def _scale(
    raw: RawCapture,
    positions: NDArray[np.float64],
    floor: FloorPlane | None,
    scale: float | None,
    camera_height: float | None,
    findings: Findings,
) -> tuple[float, bool]:
    """Metres per unit and whether it is known."""
    height = None if floor is None else float(np.median(floor.height_of(positions)))
    if scale is not None:
        return scale, True
    lowest, highest = PLAUSIBLE_HEIGHT
    if raw.metric and (height is None or lowest <= height <= highest):
        if camera_height is not None and height is not None and not 0.75 < camera_height / height < 1.33:
            findings.warning(
                f"the cameras are {height:.2f} m above the floor, not {camera_height:g} m",
                raw.source.name,
                "the metres of the capture are kept; give a scale to override them",
            )
        if raw.metric_because:
            by_that = "" if height is None else f"the cameras are {height:.2f} m above the floor by that; "
            findings.note(
                f"lengths are taken to be in meters because {raw.metric_because}",
                raw.source.name,
                f"{by_that}--scale METRES overrides it",
            )
        return 1.0, True
    if raw.metric:
        findings.warning(
            f"the cameras are {height:.3g} units above the floor, so the unit is not the metre",
            raw.source.name,
            "the scale has to be given: --camera-height METRES or --scale METRES",
        )
    if camera_height is None:
        return 1.0, False
    if height is None or height <= 1e-6 * camera_height:
        raise InputError(
            f"{raw.source} shows no floor below the cameras to measure the camera height from; "
            "give the metres per unit with --scale instead."
        )
    return camera_height / height, True


def to_aligned_frame(points: NDArray[np.floating], alignment: Alignment) -> NDArray[np.float64]:
    """Points (..., 3) of the source in the aligned frame, metres."""
    return np.asarray(alignment.scale * ((np.asarray(points, np.float64) - alignment.origin) @ alignment.rotation.T))


def to_capture_frame(points: NDArray[np.floating], alignment: Alignment) -> NDArray[np.float64]:
    """Points (..., 3) of the aligned frame back in the source's frame and unit: what `--frame capture` writes."""
    return np.asarray((np.asarray(points, np.float64) / alignment.scale) @ alignment.rotation + alignment.origin)


def apply(raw: RawCapture, alignment: Alignment) -> Capture:
    """The typed capture: frames with pose and lens, in the aligned frame. An identity leaves every number as it was.
    `alignment` may have another origin than `raw`: that of a capture which this one is added to."""
    known, (x, y, z) = alignment, np.subtract(alignment.origin, raw.origin)
    alignment = replace(alignment, origin=(float(x), float(y), float(z)))  # of what is left of the coordinates
    frames = []
    for f in raw.frames:
        if f.camera_to_world is None or f.lens is None:
            continue
        pose = _turned(f.camera_to_world, alignment)
        frames.append(Frame(f.name, f.image_path, f.lens, pose, f.sensor, f.timestamp, f.mask, f.rig))
    cloud = raw.cloud
    if cloud is not None and not alignment.is_identity:
        cloud = Cloud(to_aligned_frame(cloud.points, alignment).astype(np.float32), cloud.colors, cloud.kind)
    scale = alignment.scale
    scans = [replace(s, to_world=_turned(s.to_world, alignment), scale=s.scale * scale) for s in raw.scans]
    depths = [
        replace(d, camera_to_world=_turned(d.camera_to_world, alignment), scale=d.scale * scale) for d in raw.depths
    ]
    return Capture(raw.source, raw.format, tuple(frames), cloud, known, tuple(scans), tuple(depths))


def _turned(pose: NDArray[np.float64], alignment: Alignment) -> NDArray[np.float64]:
    if alignment.is_identity:
        return pose
    turned = np.eye(4)
    turned[:3, :3] = alignment.rotation @ pose[:3, :3]
    turned[:3, 3] = to_aligned_frame(pose[:3, 3], alignment)
    return turned
