"""Transform a capture from the frame of its files to the aligned frame: z up, meters.

The rotation is the smallest one about the origin that brings up to z. The scale is stored separately. If the
coordinates are far from the origin, `read.py` subtracts an origin first.

The up direction comes from the cameras, which people and robots hold level on average. The dominant floor plane of the
point cloud refines it. If the point cloud shows no floor, the depth images or points triangulated from the images are
used. Without a LiDAR scan and depth images, vertical edges in the images refine it further. A capture whose up
direction is within 2 degrees of z is not rotated.

The scale is known in these cases:
- the user gives the scale;
- the source claims meters, and its cameras have a plausible height above the floor;
- the user gives the camera height above the floor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.depth_images import depth_points
from nvsim.capture.findings import Findings
from nvsim.capture.floor_plane import FloorPlane, find_floor
from nvsim.capture.raw import RawCapture
from nvsim.capture.triangulation import image_points
from nvsim.capture.types import Alignment, Capture, Cloud, Frame
from nvsim.capture.vertical_edges import vertical_from_images
from nvsim.errors import InputError
from nvsim.geometry.camera import quarter_turns
from nvsim.geometry.rotation import smallest_rotation

_FORM = "give IMAGE,IMAGE,METERS, such as 0001.jpg,0150.jpg,4.2"


def scale_from_length(text: str, raw: RawCapture) -> float:
    """Meters per unit of `raw`, from a known distance between two cameras.

    `text` holds the names of two images and the meters between their cameras, separated by commas. A name may contain
    commas. Raises InputError if the text has another form, an image has no pose in the capture, or the two cameras
    coincide."""
    *words, last = text.split(",")
    try:
        meters = float(last)
    except ValueError:
        meters = 0.0
    if len(words) < 2 or not (np.isfinite(meters) and 0 < meters < 1e6):
        raise InputError(f"--known-length {text} is not a length between two images; {_FORM}.")
    places = {f.name: f.camera_to_world[:3, 3] for f in raw.frames if f.camera_to_world is not None}
    pairs = [(",".join(words[:k]).strip(), ",".join(words[k:]).strip()) for k in range(1, len(words))]
    one, other = next((pair for pair in pairs if set(pair) <= set(places)), pairs[0])
    for name in (one, other):
        if name not in places:
            example = f", such as {min(places)}" if places else ""
            raise InputError(f"--known-length names {name!r}, which is not an image with a pose; use another{example}.")
    distance = float(np.linalg.norm(places[one] - places[other]))
    extent = float(np.ptp(np.array(list(places.values())), axis=0).max())
    if not distance > 1e-3 * extent:
        raise InputError(
            f"The cameras of {one} and {other} are at the same place; name two images that are far from each other."
        )
    return meters / distance


UNTOUCHED_DEGREES = 2.0
PLAUSIBLE_HEIGHT = (0.1, 6.0)  # meters of a camera above the floor: from a robot vacuum to a raised pole
_UNSURE_DEGREES = 20.0  # possible error of the up direction if all cameras may lean to the same side
_UNEVEN_DEGREES = 3.0  # possible tilt of the floor against the vertical edges, because poses drift
_Z = np.array([0.0, 0.0, 1.0])
_CLEARER = 0.05  # see `are_sideways`: difference of the largest eigenvalues of both axes
_TURNED = 0.2  # see `are_sideways`: about 45 degrees to either side
HELD_UPRIGHT = 3  # counterclockwise quarter turns for images of a phone held upright, as nearly all phones store them


def turned_pose(poses: NDArray[np.float64], turns: int) -> NDArray[np.float64]:
    """The camera-to-world poses (..., 4, 4) of the images after `turns` counterclockwise quarter turns."""
    turned = poses.copy()
    turned[..., :3, :3] = poses[..., :3, :3] @ quarter_turns(turns).T
    return turned


def are_sideways(rights: NDArray[np.float64], downs: NDArray[np.float64], least_turn: float = _TURNED) -> bool:
    """Whether most images of a walk are stored sideways, from their right and down axes (N, 3) in the world.

    People turn more about the vertical than about other axes, so the image axis along the vertical has nearly the same
    direction in all images, and the other one many directions. False if these are nearly one direction: then the
    second eigenvalue of their second moments is less than `least_turn`."""
    values, axes = np.linalg.eigh(rights.T @ rights / len(rights))
    _, second, largest = np.linalg.eigvalsh(downs.T @ downs / len(downs))
    # Unlike the image axis along the vertical, horizontal directions of a walk cancel each other.
    has_one_sense = abs((rights @ axes[:, 2]).mean()) > abs((downs @ axes[:, 0]).mean())
    return bool(has_one_sense and values[2] > largest + _CLEARER and second > least_turn)


def find_up(poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """(3,) unit vector that points up, from camera-to-world poses (N, 4, 4), N > 0; and its possible error in degrees.

    The first estimate is the geometric median of the cameras' up vectors, so a few cameras mounted on their side have
    no influence. If the cameras look in several directions, a second estimate is better: the direction that is most
    nearly perpendicular to the cameras' right vectors. It does not lean when all cameras look down. It is used if it
    is within 40 degrees of the first estimate. Sideways images are taken for those of a phone held upright.
    """
    if are_sideways(poses[:, :3, 0], poses[:, :3, 1]):
        poses = turned_pose(poses, HELD_UPRIGHT)
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
    """The alignment of a capture, and its floor plane in the frame and unit of the source.

    The floor plane is None if neither the point cloud nor the images show a floor. Raises InputError if `scale` or
    `camera_height` is not positive or cannot be applied."""
    for value, name in ((scale, "scale"), (camera_height, "camera height")):
        if value is not None and not (np.isfinite(value) and 0 < value < 1e6):
            raise InputError(f"The {name} {value:g} is not a positive number of meters; give one like 1.2.")
    poses = np.array([f.camera_to_world for f in raw.frames if f.camera_to_world is not None])
    if not len(poses):
        return Alignment(np.eye(3), scale or 1.0, scale is not None, raw.origin), None
    up, unsure = find_up(poses)
    positions = poses[:, :3, 3]
    floor, basis = None, "the cameras alone"
    for seen_in, points in _points(raw):
        floor = find_floor(points, positions, up, unsure)
        if floor is not None:
            up, basis = floor.normal, f"the cameras and the floor of {seen_in}"
            break
    if not raw.depths and (raw.cloud is None or not raw.cloud.is_dense):
        edges = vertical_from_images(raw.frames, up)
        if edges is not None:
            up, basis = edges, "vertical edges in the images"
            if floor is not None:
                floor = find_floor(points, positions, up, _UNEVEN_DEGREES) or floor
    tilt = float(np.degrees(np.arccos(np.clip(up[2], -1, 1))))
    if tilt <= UNTOUCHED_DEGREES:
        rotation = np.eye(3)
    else:
        rotation = smallest_rotation(up, _Z)
        findings.note(
            f"up is {tilt:.1f} degrees away from z, judged from {basis}",
            raw.source.name,
            "the capture is rotated about the origin so that z points up; exports can undo the rotation",
        )
    units, known = _scale(raw, positions, floor, scale, camera_height, findings)
    return Alignment(rotation, units, known, raw.origin), floor


def _points(raw: RawCapture) -> Iterator[tuple[str, NDArray[np.floating]]]:
    """The sources of points (N, 3) in which a floor is searched, in the unit and frame of the source, with their
    names."""
    if raw.cloud is not None:
        yield "the cloud", raw.cloud.points
    if raw.depths:
        yield "the depth images", depth_points(raw.depths)
    if raw.cloud is None or not raw.cloud.is_dense:
        yield "the images", image_points(raw.frames)


def _scale(
    raw: RawCapture,
    positions: NDArray[np.float64],
    floor: FloorPlane | None,
    scale: float | None,
    camera_height: float | None,
    findings: Findings,
) -> tuple[float, bool]:
    """Meters per unit of the source, and whether the scale is known."""
    height = None if floor is None else float(np.median(floor.height_of(positions)))
    if scale is not None:
        return scale, True
    lowest, highest = PLAUSIBLE_HEIGHT
    if raw.metric and (height is None or lowest <= height <= highest):
        if camera_height is not None and height is not None and not 0.75 < camera_height / height < 1.33:
            findings.warning(
                f"the cameras are {height:.2f} m above the floor, not {camera_height:g} m",
                raw.source.name,
                "the meters of the capture are used; give a scale to override them",
            )
        if raw.metric_because:
            by_that = "" if height is None else f"the cameras are then {height:.2f} m above the floor; "
            findings.note(
                f"lengths are taken to be in meters because {raw.metric_because}",
                raw.source.name,
                f"{by_that}--scale METERS overrides it",
            )
        return 1.0, True
    if raw.metric:
        findings.warning(
            f"the cameras are {height:.3g} units above the floor, so the unit is not the meter",
            raw.source.name,
            "give the scale with --camera-height METERS or --scale METERS",
        )
    if camera_height is None:
        return 1.0, False
    if height is None or height <= 1e-6 * camera_height:
        raise InputError(
            f"{raw.source} shows no floor below the cameras, so the camera height cannot be measured; "
            "give the distance between two cameras with --known-length, or the meters per unit with --scale."
        )
    return camera_height / height, True


def to_aligned_frame(points: NDArray[np.floating], alignment: Alignment) -> NDArray[np.float64]:
    """(..., 3) float64 points in meters, aligned frame, from `points` (..., 3) in the frame and unit of the source."""
    return np.asarray(alignment.scale * ((np.asarray(points, np.float64) - alignment.origin) @ alignment.rotation.T))


def to_capture_frame(points: NDArray[np.floating], alignment: Alignment) -> NDArray[np.float64]:
    """(..., 3) float64 points in the frame and unit of the source, from `points` (..., 3) in meters, aligned frame.

    The option `--frame capture` of exports uses this frame."""
    return np.asarray((np.asarray(points, np.float64) / alignment.scale) @ alignment.rotation + alignment.origin)


def apply(raw: RawCapture, alignment: Alignment) -> Capture:
    """The typed capture in the aligned frame. It contains only frames that have both a pose and a lens.

    An identity alignment changes no number. The origin of `alignment` may differ from that of `raw`, if `raw` is added
    to another capture."""
    known, (x, y, z) = alignment, np.subtract(alignment.origin, raw.origin)
    alignment = replace(alignment, origin=(float(x), float(y), float(z)))  # the rest that `raw` has not subtracted yet
    frames = []
    for f in raw.frames:
        if f.camera_to_world is None or f.lens is None:
            continue
        pose = _aligned_pose(f.camera_to_world, alignment)
        frames.append(Frame(f.name, f.image_path, f.lens, pose, f.sensor, f.timestamp, f.mask, f.rig))
    cloud = raw.cloud
    if cloud is not None and not alignment.is_identity:
        cloud = Cloud(to_aligned_frame(cloud.points, alignment).astype(np.float32), cloud.colors, cloud.kind)
    scale = alignment.scale
    scans = [replace(s, to_world=_aligned_pose(s.to_world, alignment), scale=s.scale * scale) for s in raw.scans]
    depths = [
        replace(d, camera_to_world=_aligned_pose(d.camera_to_world, alignment), scale=d.scale * scale)
        for d in raw.depths
    ]
    return Capture(raw.source, raw.format, tuple(frames), cloud, known, tuple(scans), tuple(depths))


def _aligned_pose(pose: NDArray[np.float64], alignment: Alignment) -> NDArray[np.float64]:
    if alignment.is_identity:
        return pose
    turned = np.eye(4)
    turned[:3, :3] = alignment.rotation @ pose[:3, :3]
    turned[:3, 3] = to_aligned_frame(pose[:3, 3], alignment)
    return turned
