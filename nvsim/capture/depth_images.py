"""Depth images of a depth camera: read them, check them, and project them into the images that they belong to."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.raw import RawCapture, file_size
from nvsim.capture.types import Capture, DepthFile
from nvsim.errors import InputError
from nvsim.files.images import decode_pixels, is_cut_off
from nvsim.files.opening import read_bytes
from nvsim.files.stored_arrays import array_of
from nvsim.geometry.camera import Camera
from nvsim.geometry.sampling import evenly_spaced

Float32 = NDArray[np.float32]
ARRAY, FLOAT_IMAGES = ".npy", (".tif", ".tiff")
_FORMATS = "a depth image has one channel of 16 bits (PNG, TIFF), or of floats (TIFF, .npy)"
_NOTHING = 65_535  # the largest 16-bit number marks missing depth as often as 0 does
_FARTHEST = 65.0  # meters
_JUMP = 0.1  # share of the inverse depth by which neighboring pixels differ across an edge
_PLAUSIBLE = (0.1, 50.0)  # meters, the median depth of an image of a building
_ESTIMATED = "the depth of the frame is estimated from the images"
_DENSER = 1.5  # pixels of a depth image per pixel of the image that it is drawn into
_SAMPLED = 60  # images in which a floor is searched
_POINTS = 400  # points of each of these images


def read_depth_image(file: DepthFile) -> NDArray[np.float64]:
    """(H, W) float64 depth in meters of the aligned frame along the optical axis, 0 where nothing was measured.

    Raises InputError if the file is missing, damaged, or not a depth image."""
    return _values(file) * (file.unit * file.scale)


def _values(file: DepthFile) -> NDArray[np.float64]:
    """(H, W) as stored, 0 where nothing was measured."""
    data = read_bytes(file.path)
    if file.is_raw:
        width, height = file.lens.width, file.lens.height
        if len(data) != 4 * width * height:
            raise InputError(
                f"{file.path} has {len(data)} bytes, not the {4 * width * height} of {width}x{height} depths as "
                "float32; copy it again from the source."
            )
        stored: NDArray[np.generic] = np.frombuffer(data, "<f4").reshape(height, width)
    elif file.path.suffix.lower() == ARRAY:
        stored = array_of(data, file.path, "a depth image", _FORMATS)
        stored = stored[..., 0] if stored.ndim == 3 and stored.shape[2] == 1 else stored
    else:
        if is_cut_off(data):
            raise InputError(f"{file.path} is truncated (its end mark is missing); copy it again from the source.")
        stored = decode_pixels(data, file.path, cv2.IMREAD_UNCHANGED, what="a depth image", then=_FORMATS)
    if stored.ndim != 2 or stored.dtype.kind not in "fiu" or stored.dtype.itemsize < 2 or not stored.size:
        raise InputError(f"{file.path} is not a depth image: {_FORMATS}; write it again.")
    found = stored.astype(np.float64)
    known = np.isfinite(found) & (found > 0)
    if stored.dtype.kind != "f":
        known &= found < _NOTHING
    if file.confidence is not None:
        confidence = decode_pixels(read_bytes(file.confidence), file.confidence, cv2.IMREAD_GRAYSCALE)
        if confidence.shape != found.shape:
            raise InputError(f"{file.confidence} does not have the size of {file.path.name}; copy both again.")
        known &= confidence > 0
    return np.where(known, found, 0.0)


def with_unit_of_floats(depths: Sequence[DepthFile]) -> list[DepthFile]:
    """The depth images of one file list, with the unit of .npy and TIFF files set to meters if they store meters.

    Writers of floats store meters as often as millimeters and seldom state the unit. If the declared unit puts the
    median depth within 0.1 m of the camera, the values are meters."""
    floats = [d for d in depths if d.path.suffix.lower() in (ARRAY, *FLOAT_IMAGES)]
    medians = []
    for depth in (floats[i] for i in evenly_spaced(len(floats), 5)):
        try:
            values = _values(depth)
        except InputError:
            continue  # the data check reports it
        if (values > 0).any():
            medians.append(float(np.median(values[values > 0])))
    if not medians or np.median(medians) * floats[0].unit >= _PLAUSIBLE[0]:
        return list(depths)
    return [replace(d, unit=1.0) if d in floats else d for d in depths]


def check_depths(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` without unusable depth images; each becomes a warning. Decodes every depth image."""
    if not raw.depths:
        return raw
    places = {f.name: f.where for f in raw.frames}

    def looked_at(depth: DepthFile) -> tuple[str, float]:
        """The fault of a depth image ("" for none) and the median of its measured depth in meters."""
        if file_size(depth.path) is None:
            return "the depth image is missing", 0.0
        try:
            found = read_depth_image(depth)
        except InputError as error:
            return str(error).replace(str(depth.path), "the depth image").rstrip("."), 0.0
        (tall, wide), lens = found.shape, depth.lens
        if abs(wide * lens.height - tall * lens.width) > max(lens.width, lens.height):
            size = f"{lens.width}x{lens.height}"
            return f"the depth image is {wide}x{tall} pixels, which does not fit an image of {size}", 0.0
        if not (found > 0).any():
            return "the depth image contains no depth (all values are 0)", 0.0
        return "", float(np.median(found[found > 0]))

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        looks = list(pool.map(looked_at, raw.depths))
    kept, medians = [], []
    for depth, (fault, median) in zip(raw.depths, looks, strict=True):
        if fault:
            findings.warning(fault, places.get(depth.frame, depth.path.name), _ESTIMATED)
        else:
            kept.append(depth)
            medians.append(median)
    typical = float(np.median(medians)) if medians else 0.0
    if kept and raw.metric and not _PLAUSIBLE[0] <= typical <= _PLAUSIBLE[1]:
        findings.warning(
            f"the depth images show surfaces {typical:.3g} m away, so their unit is wrong",
            raw.source.name,
            "they are ignored and depth is estimated; correct integer_depth_scale or depth_unit_scale_factor",
        )
        kept = []
    return replace(raw, depths=tuple(kept))


def report_depths(capture: Capture, findings: Findings) -> None:
    """Add findings about the use of the depth images of `capture`, and about frames without a depth image."""
    if not capture.depths:
        return
    place, with_depth, count = capture.source.name, len(capture.depth_of_frames), len(capture.frames)
    loose = len(capture.depths) - with_depth
    if loose:
        message = f"{loose} depth images belong to no frame"
        findings.note(message, place, "only `nvsim occupancy build` uses them")
    if not with_depth:
        return
    has_scan = capture.cloud is not None and capture.cloud.is_dense
    use = "they replace estimated depth for their frames and for the point cloud"
    if has_scan:
        use = "the LiDAR scan is used; with --depth always, the depth images fill its gaps"
    findings.note(f"{with_depth} of {count} frames have a depth image", place, use)
    if with_depth < count and not has_scan:
        findings.warning(f"{count - with_depth} of {count} frames have no depth image", place, _ESTIMATED)


def inverse_depth(file: DepthFile, camera: Camera) -> Float32:
    """(H, W) float32 inverse depth in 1 / meters, 0 where unknown: the depth image as `camera` sees it.

    If the depth camera has another pose, its depth is projected into the view of `camera`. Raises InputError if the
    file cannot be read."""
    stored = read_depth_image(file)
    with np.errstate(divide="ignore"):
        inverse = np.where((stored > 0) & (stored < _FARTHEST), 1 / stored, 0).astype(np.float32)
    inverse[_flying(inverse)] = 0
    k, own = camera.intrinsics, file.lens.pinhole
    here, there = ((i.fx / i.width, i.fy / i.height, i.cx / i.width, i.cy / i.height) for i in (k, own))
    if np.allclose(here, there, rtol=0, atol=1e-3) and np.allclose(
        camera.camera_to_world, file.camera_to_world, atol=1e-6
    ):
        return _sample_depth(inverse, file, camera)
    finer = _DENSER * k.fx / own.fx
    size = max(1, round(finer * own.width)), max(1, round(finer * own.height))
    source = Camera(own.scaled(*size), file.camera_to_world)
    return _reproject_depth(_sample_depth(inverse, file, source), source, camera)


def _flying(inverse: Float32) -> NDArray[np.bool_]:
    """(H, W) bool pixels whose depth is between those on either side and far from both: mixtures of two surfaces."""
    found = np.zeros(inverse.shape, bool)
    limit = _JUMP * inverse
    for axis in (0, 1):
        if inverse.shape[axis] < 3:
            continue
        w, least, mark = np.moveaxis(inverse, axis, 0), np.moveaxis(limit, axis, 0), np.moveaxis(found, axis, 0)
        before, after = w[1:-1] - w[:-2], w[2:] - w[1:-1]
        far = np.minimum(np.abs(before), np.abs(after)) > least[1:-1]
        mark[1:-1] |= far & (before * after > 0) & (w[:-2] > 0) & (w[2:] > 0)
    return found & (inverse > 0)


def _sample_depth(inverse: Float32, file: DepthFile, camera: Camera) -> Float32:
    """A depth image (h, w) sampled at the pixels of a pinhole `camera` with the same pose.

    Inverse depth is linear on a plane. It is interpolated if the four surrounding pixels show one surface; across an
    edge the nearest pixel is used."""
    height, width = inverse.shape
    mapping = (file.lens.undistort_map(camera.intrinsics) + 0.5) * (width / file.lens.width, height / file.lens.height)
    x, y = np.moveaxis(mapping - 0.5, -1, 0)
    inside = (x > -1) & (y > -1) & (x < width) & (y < height)
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    corners = np.stack([inverse[top, left], inverse[top, right], inverse[below, left], inverse[below, right]])
    a, b = x - left, y - top
    mean = (1 - b) * ((1 - a) * corners[0] + a * corners[1]) + b * ((1 - a) * corners[2] + a * corners[3])
    nearest = inverse[np.rint(y).astype(np.int64), np.rint(x).astype(np.int64)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    found = np.where((low > 0) & (high - low < _JUMP * high), mean, nearest)
    return np.where(inside, found, 0).astype(np.float32)


def _reproject_depth(inverse: Float32, there: Camera, camera: Camera) -> Float32:
    """The depth map (h, w) of camera `there` in the view of `camera`. If several points fall on a pixel, the nearest
    surface is used."""
    points = points_of(inverse, there)
    pixels, depth = camera.project(points)
    k = camera.intrinsics
    u, v = np.floor(pixels).astype(np.int64).T
    shown = (depth > 1e-3) & (u >= 0) & (v >= 0) & (u < k.width) & (v < k.height)
    found = np.zeros((k.height, k.width), np.float32)
    np.maximum.at(found, (v[shown], u[shown]), (1 / depth[shown]).astype(np.float32))
    return found


def points_of(inverse: Float32, camera: Camera) -> NDArray[np.float64]:
    """(N, 3) float64 points, meters, world: the known pixels of a map (H, W) of inverse depth in 1 / meters, row by
    row."""
    rows, columns = np.nonzero(inverse)
    k, z = camera.intrinsics, 1 / inverse[rows, columns].astype(np.float64)
    local = np.stack([(columns + 0.5 - k.cx) / k.fx * z, (rows + 0.5 - k.cy) / k.fy * z, z], axis=1)
    return np.asarray(local @ camera.rotation.T + camera.position)


def depth_points(depths: Sequence[DepthFile]) -> NDArray[np.float64]:
    """(N, 3) float64 points of a sample of the depth images, in the unit and frame of their poses. The sample is large
    enough to find the floor. Depth images that cannot be read are skipped."""
    found = [np.zeros((0, 3))]
    for depth in (depths[i] for i in evenly_spaced(len(depths), _SAMPLED)):
        side = max(depth.lens.width, depth.lens.height)
        camera = Camera(depth.lens.pinhole.limited_to(min(side, 160)), depth.camera_to_world)
        try:
            points = points_of(inverse_depth(depth, camera), camera)
        except InputError:
            continue  # the data check reports it
        found.append(points[:: max(1, len(points) // _POINTS)])
    return np.concatenate(found)
