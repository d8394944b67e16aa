"""The fields of a transforms.json as typed values: fields that NVSim uses, fields that it reports as unused, and marks
of the unit.

Every getter raises only InputError, with the problem and the place.

nerfstudio keeps the unit of its source. It is metric for scanners and phones and arbitrary for reconstructions from
images. The unit is therefore unknown unless there is a mark of a metric source: a field `unit`, depth images of a
sensor, or a LiDAR scan.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.findings import Findings
from nvsim.capture.raw import read_text
from nvsim.capture.types import Cloud
from nvsim.errors import InputError, value_text

Tree = Mapping[str, Any]


def load_object(path: Path) -> dict[str, Any]:
    """The JSON object in `path`. Raises InputError with line and column if it is not a JSON object."""
    text = read_text(path)
    try:
        tree = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path} is not valid JSON (line {error.lineno}, column {error.colno}: {error.msg}); write it again."
        ) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not usable JSON ({type(error).__name__}); write it again.") from error
    if not isinstance(tree, dict):
        raise InputError(f"{path} holds a JSON {type(tree).__name__}, not an object; write an object.")
    return tree


def number(tree: Tree, key: str, where: str) -> float | None:
    """A finite number, or None if the key is absent. Raises InputError otherwise."""
    value = tree.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: {key!r} is {_short_text(value)}, not a number; correct it.")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise InputError(f"{where}: {key!r} is not a finite number; correct it.")
    return result


def text(tree: Tree, key: str, where: str) -> str | None:
    """A non-empty string, or None if the key is absent. Raises InputError otherwise."""
    value = tree.get(key)
    if value is None:
        return None
    if not isinstance(value, str) or not value:
        raise InputError(f"{where}: {key!r} is {_short_text(value)}, not a string; correct it.")
    return value


def matrix(value: object, where: str) -> NDArray[np.float64]:
    """(4, 4) float64 from nested lists of 4x4 or 3x4 numbers. NaN and infinity are kept; a later check reports them.
    Raises InputError if `value` is not such a matrix."""
    rows = value if isinstance(value, list) else []
    if len(rows) not in (3, 4) or not all(isinstance(row, list) and len(row) == 4 for row in rows):
        raise InputError(f"{where}: 'transform_matrix' is not a 4x4 matrix of numbers; correct it.")
    result = np.eye(4)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            if isinstance(entry, bool) or not isinstance(entry, int | float):
                raise InputError(f"{where}: 'transform_matrix' holds {_short_text(entry)}, not a number; correct it.")
            try:
                result[i, j] = float(entry)
            except OverflowError:
                result[i, j] = math.inf
    return result


def _short_text(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= 40 else shown[:37] + "..."


LENS_FIELDS = (
    *("camera_model", "is_fisheye", "w", "h", "camera_angle_x", "camera_angle_y", "distortion_params"),
    *("fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2"),
)
_DEPTH = ("depth_file_path", "depth_path")
_USED = {
    *LENS_FIELDS,
    *_DEPTH,
    *("integer_depth_scale", "depth_unit_scale_factor", "mask_path"),
    *("frames", "file_path", "transform_matrix", "timestamp", "ply_file_path"),
    *("applied_scale", "colmap_im_id", "aabb_scale", "unit", "units"),
}
_BOOKKEEPING = {
    # Earlier processing of the data, which the poses already include.
    *("applied_transform", "orientation_override", "auto_scale_poses_override", "worldtogt", "pairs"),
    # A region or a depth range for rendering.
    *("aabb", "scene_box", "render_aabb", "render_aabb_to_local", "near", "far", "radius", "collider_type"),
    *("scale", "offset", "up", "n_extra_learnable_dims", "white_transparent", "black_transparent", "fix_premult"),
    *("enable_depth_loading", "enable_ray_loading", "sharpness_discard_threshold", "has_mono_prior"),
    # Names, and image properties measured by other programs.
    *("sharpness", "blur_score", "motion_blur_score", "rotation", "colmap_id", "camera_id", "cam_id", "image_id"),
    *("id", "name", "frame_id", "image_name", "img_name", "camera_label", "has_mask", "camera", "date", "version"),
}
_UNUSED = {
    **dict.fromkeys(
        ("normal_path", "normal_file_path", "mono_normal_path", "sensor_normal_path", "file_path_normal", "normals"),
        "surface normals",
    ),
    **dict.fromkeys(("mono_depth_path", "sensor_depth_path", "file_path_depth", "depth"), "depth under another name"),
    **dict.fromkeys(("confidence_path", "confidence_file_path", "depth_confidence_path"), "confidence of depth"),
    **dict.fromkeys(
        ("semantics", "semantic_path", "semantics_path", "semantic_file_path", "segmentation_path", "label_path"),
        "labels of pixels",
    ),
    **dict.fromkeys(
        ("panoptics", "panoptic_path", "panoptic_file_path", "panoptic_classes", "instance_path", "instances"),
        "labels of objects",
    ),
    **dict.fromkeys(
        ("sky_mask_path", "sky_mask", "foreground_mask", "dynamic_mask_path", "dynamic_masks", "masks", "mask"),
        "masks; NVSim reads mask_path",
    ),
    "mask_color": "the color of ignored pixels",
    **dict.fromkeys(
        ("rolling_shutter", "rolling_shutter_time", "exposure_time", "transform_matrix_start", "transform_matrix_end"),
        "motion during the exposure; all rows use the pose of the image",
    ),
    **dict.fromkeys(
        ("camera_linear_velocity", "camera_angular_velocity", "velocities"),
        "motion of the camera; all rows use the pose of the image",
    ),
    "time": "the time of a moving scene, which is treated as static",
    "fisheye_crop_radius": "the circle outside which a fisheye image is black",
    **dict.fromkeys(("latlong", "lens_mode", "ftheta_p0"), "another lens; the images are read as perspective"),
    **dict.fromkeys(
        ("train_filenames", "val_filenames", "test_filenames"), "a split; --hold-out selects held-out frames"
    ),
    "test_frames": "frames of a test set, which are not read",
    "is_bad": "frames marked as bad, which are used; --leave-out removes frames",
    **dict.fromkeys(("light", "light_direction", "driver_parameters", "envmap"), "the lighting"),
}
"""Fields that other programs write and NVSim does not use -> a description of their content."""
_LISTED = 20
_FEATURE_CLOUDS = ("sparse", "points3d", "sfm", "colmap", "reconstruction")  # prefixes of file names
_LEAST_SCAN = 1000  # points
_METERS = {"m", "meter", "meters", "metre", "metres"}


def report_unused(tree: Tree, frames: Sequence[Tree], where: str, findings: Findings) -> None:
    """Add a warning that lists the known fields that NVSim does not use, and a note that lists unknown fields. Fields
    without a value count as absent."""
    fields = dict.fromkeys(_fields_with_values(tree))
    for frame in frames:
        fields.update(dict.fromkeys(_fields_with_values(frame)))
    unused = [f"{field} ({_UNUSED[field]})" for field in fields if field in _UNUSED]
    if unused:
        findings.warning(
            f"NVSim does not use {_list_names(unused)}",
            where,
            "the content of these fields has no effect on the map",
        )
    known = _USED | _BOOKKEEPING | _UNUSED.keys()
    unknown = [value_text(field, 40) for field in fields if field not in known]
    if unknown:
        findings.note(f"NVSim does not know the fields {_list_names(unknown)}", where, "they are ignored")


def is_arbitrary(tree: Tree, frames: Sequence[Tree]) -> bool:
    """Whether the unit comes from a reconstruction of images, and is therefore arbitrary.

    The marks are fields and files of COLMAP, an applied scale, files of instant-ngp, and files without a lens, as
    synthetic captures with a camera angle have."""
    from_colmap = tree.get("ply_file_path") == "sparse_pc.ply" or any("colmap_im_id" in f for f in frames)
    rescaled = tree.get("applied_scale", 1.0) != 1.0
    has_lens = "camera_model" in tree or "fl_x" in tree or any("fl_x" in f for f in frames)
    return from_colmap or rescaled or not has_lens or is_instant_ngp(tree)


def is_instant_ngp(tree: Tree) -> bool:
    return "aabb_scale" in tree or ("is_fisheye" in tree and "camera_model" not in tree)


def is_feature_cloud(listed: str) -> bool:
    """Whether programs give this file name to the point cloud of image features."""
    return PurePosixPath(listed.replace("\\", "/")).name.lower().startswith(_FEATURE_CLOUDS)


def unit_of(tree: Tree, frames: Sequence[Tree], cloud: Cloud | None) -> tuple[bool | None, str]:
    """Whether the unit is the meter (None if unknown), and the mark that makes it likely.

    The mark is "" if there is none, or if a field states the unit."""
    for field in ("unit", "units"):
        unit = tree.get(field)
        if isinstance(unit, str) and unit.lower() in _METERS:
            return True, ""
    if is_arbitrary(tree, frames):
        return False, ""
    if any(f.get(field) for f in frames for field in _DEPTH):
        return True, "depth images of a sensor come with the images"
    if cloud is not None and cloud.is_dense and len(cloud.points) >= _LEAST_SCAN:
        return True, f"the point cloud {value_text(tree.get('ply_file_path'), 60)} seems to be a LiDAR scan"
    return None, ""


def _fields_with_values(tree: Mapping[str, object]) -> Iterator[str]:
    """The fields that have a value: not null, false, zero, or empty."""
    return (field for field, value in tree.items() if value)


def _list_names(words: Sequence[str]) -> str:
    more = f" and {len(words) - _LISTED} more" if len(words) > _LISTED else ""
    return ", ".join(words[:_LISTED]) + more
