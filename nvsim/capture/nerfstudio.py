"""nerfstudio's transforms.json and its older relative, instant-ngp's.

Camera axes in the file are OpenGL's (x right, y up, z back); poses are camera-to-world. `applied_transform` says what
was once done to the original data: the saved poses and the saved cloud already agree, so it is not undone.

Whether the unit is the metre: nerfstudio keeps the unit of its source, which is metric for scanners and phones, and
arbitrary for COLMAP. So a file is metric unless it shows COLMAP's marks (`colmap_im_id`, `sparse_pc.ply`), was rescaled
(`applied_scale` other than 1), or is instant-ngp's or the older synthetic kind, which never were.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from nvsim.capture import json_tree
from nvsim.capture.depth_images import with_unit_of_floats
from nvsim.capture.findings import Findings
from nvsim.capture.json_tree import Tree
from nvsim.capture.lens_reading import read_lens
from nvsim.capture.pointcloud import read_cloud
from nvsim.capture.raw import LOST_FRAME, RawCapture, RawFrame, checked_pose, file_size
from nvsim.capture.types import DepthFile, MaskFile
from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.geometry.lens import Lens

_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_EXTENSIONS = (".png", ".jpg", ".jpeg", ".JPG", ".JPEG", ".PNG")
_PERSPECTIVE = {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "FULL_OPENCV", "PERSPECTIVE"}
_FISHEYE = {"OPENCV_FISHEYE", "FISHEYE"}
_LENS_KEYS = (
    *("camera_model", "is_fisheye", "w", "h", "camera_angle_x", "camera_angle_y"),
    *("fl_x", "fl_y", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2"),
)


def find(path: Path) -> Path | None:
    """The transforms.json of a folder; a file may have any name that ends in .json."""
    if not path.is_dir():
        return path if path.suffix.lower() == ".json" else None
    return path / "transforms.json" if file_size(path / "transforms.json") is not None else None


def read(path: Path, findings: Findings) -> RawCapture:
    """The capture of a transforms.json. What is wrong with a frame goes to `findings`; raises InputError when the file
    as a whole cannot be read."""
    with reading(path, "a transforms.json"):
        return _read(path, findings)


def _read(path: Path, findings: Findings) -> RawCapture:
    tree = json_tree.load_object(path)
    frames = tree.get("frames")
    if not isinstance(frames, list):
        raise InputError(f"{path} has no list 'frames', so it is not a transforms.json; choose another file.")
    read, depths = [], []
    lenses: dict[str, Lens | None] = {}
    for i, entry in enumerate(frames):
        where = f"{path.name}, frame {i}"
        if not isinstance(entry, dict):
            findings.error("the frame is not a JSON object", where, LOST_FRAME)
            continue
        frame = _frame(path, tree, entry, i, where, lenses, findings)
        if frame is not None:
            read.append(frame)
            depths += _depth(path, tree, entry, frame, where, findings)
    if all("timestamp" in f for f in frames if isinstance(f, dict)):
        read.sort(key=lambda f: f.timestamp)
    ngp = "aabb_scale" in tree or ("is_fisheye" in tree and "camera_model" not in tree)
    if ngp:
        read.sort(key=lambda f: f.name)  # its converter lists them in the order in which they were registered
    metric = not ngp and _is_metric(tree, [f for f in frames if isinstance(f, dict)])
    cloud = None
    try:
        listed = json_tree.text(tree, "ply_file_path", path.name)
        if listed is not None:
            cloud = read_cloud(_resolve(path.parent, listed), findings, kind="lidar" if metric else "sfm")
    except InputError as error:
        findings.error(str(error).rstrip("."), f"{path.name}, ply_file_path", "there would be no floor to measure")
    return RawCapture(
        path, "instant-ngp" if ngp else "nerfstudio", tuple(read), cloud, metric, (), tuple(with_unit_of_floats(depths))
    )


def _is_metric(tree: Tree, frames: list[Tree]) -> bool:
    from_colmap = tree.get("ply_file_path") == "sparse_pc.ply" or any("colmap_im_id" in f for f in frames)
    rescaled = tree.get("applied_scale", 1.0) != 1.0
    own = "camera_model" in tree or "fl_x" in tree or any("fl_x" in f for f in frames)
    return own and not from_colmap and not rescaled


def _frame(
    path: Path, tree: Tree, entry: Tree, index: int, where: str, lenses: dict[str, Lens | None], findings: Findings
) -> RawFrame | None:
    try:
        listed = json_tree.text(entry, "file_path", where)
        if listed is None:
            raise InputError(f"{where}: the field 'file_path' is missing; add it.")
        name = _name(listed)
        where = f"{where} ({name})"
        image = _resolve(path.parent, listed)
        lens = _lens(tree, entry, image, where, lenses, findings)
        pose = None
        if entry.get("transform_matrix") is None:
            findings.error("the frame has no pose (no field 'transform_matrix')", where, "the frame cannot be placed")
        else:
            pose = checked_pose(json_tree.matrix(entry["transform_matrix"], where), where, findings)
        timestamp = json_tree.number(entry, "timestamp", where)
    except InputError as error:
        findings.error(str(error).removeprefix(f"{where}: ").rstrip("."), where, LOST_FRAME)
        return None
    if pose is not None:
        pose = pose @ _OPENGL_TO_OPENCV
    time = float(index) if timestamp is None else timestamp
    return RawFrame(name, image, lens, pose, where, "camera", time, _mask(path, tree, entry, where, findings))


def _mask(path: Path, tree: Tree, entry: Tree, where: str, findings: Findings) -> MaskFile | None:
    """The mask of a frame, or the one of all frames; black is ignored."""
    try:
        listed = json_tree.text({"mask_path": tree.get("mask_path"), **entry}, "mask_path", where)
    except InputError as error:
        findings.warning(str(error).removeprefix(f"{where}: ").rstrip("."), where, "the mask is not used")
        return None
    return None if listed is None else MaskFile(_resolve(path.parent, listed).absolute())


def _depth(
    path: Path, tree: Tree, entry: Tree, frame: RawFrame, where: str, findings: Findings
) -> list[DepthFile]:  # fmt: skip
    """The depth image of a frame that has one; it shares the frame's pose and lens. Values are millimetres unless the
    frame or the file says how long a unit is."""
    try:
        listed = json_tree.text(entry, "depth_file_path", where) or json_tree.text(entry, "depth_path", where)
        both = {**tree, **entry}
        units = [json_tree.number(both, key, where) for key in ("integer_depth_scale", "depth_unit_scale_factor")]
        unit = next((u for u in units if u is not None), 0.001)
        if listed is not None and unit <= 0:
            raise InputError(f"{where}: the unit of the depth image, {unit:g}, is not positive.")
    except InputError as error:
        findings.warning(str(error).removeprefix(f"{where}: ").rstrip("."), where, "the frame has no depth image")
        return []
    if listed is None or frame.lens is None or frame.camera_to_world is None:
        return []
    file = _resolve(path.parent, listed)
    return [DepthFile(file, frame.lens, frame.camera_to_world, frame.name, unit=unit)]


def _name(listed: str) -> str:
    parts = [p for p in listed.replace("\\", "/").split("/") if p not in ("", ".")]
    return "/".join(parts) or listed


def _resolve(folder: Path, listed: str) -> Path:
    """Where `listed` lies: as written, with forward slashes, or with the extension that older files leave out."""
    candidates = [listed, listed.replace("\\", "/")]
    if not Path(candidates[1]).suffix:
        candidates += [candidates[1] + extension for extension in _EXTENSIONS]
    for candidate in candidates:
        if file_size(folder / candidate) is not None:
            return folder / candidate
    return folder / candidates[1]


def _lens(
    tree: Tree, entry: Tree, image: Path, where: str, lenses: dict[str, Lens | None], findings: Findings
) -> Lens | None:
    """The frame's own camera, or the file's; equal ones are one object, and a fault in one is reported once."""
    own = {key: entry[key] for key in _LENS_KEYS if key in entry}
    known = str(sorted(own.items()))
    if known not in lenses:
        place = where if own else where.split(",")[0]
        try:
            lenses[known] = _parse_lens({**tree, **own}, image, place, findings)
        except InputError as error:
            findings.error(str(error).removeprefix(f"{place}: ").rstrip("."), place, "no frame can use this camera")
            lenses[known] = None
    return lenses[known]


def _parse_lens(tree: Tree, image: Path, where: str, findings: Findings) -> Lens | None:
    def get(key: str, default: float) -> float:
        value = json_tree.number(tree, key, where)
        return default if value is None else value

    width, height = json_tree.number(tree, "w", where), json_tree.number(tree, "h", where)
    if width is None or height is None:
        from nvsim.capture.images import image_size

        width, height = image_size(image)
    fx = json_tree.number(tree, "fl_x", where)
    if fx is None:
        angle = json_tree.number(tree, "camera_angle_x", where)
        if angle is None or not 0 < angle < math.pi:
            raise InputError(f"{where}: there is neither 'fl_x' nor a 'camera_angle_x' between 0 and pi; add one.")
        fx = width / 2 / math.tan(angle / 2)
    vertical = json_tree.number(tree, "camera_angle_y", where)
    by_angle = height / 2 / math.tan(vertical / 2) if vertical and 0 < vertical < math.pi and "fl_x" not in tree else fx
    pinhole = (fx, get("fl_y", by_angle), get("cx", width / 2), get("cy", height / 2))
    k = [get(f"k{i}", 0.0) for i in (1, 2, 3, 4)]
    p = [get("p1", 0.0), get("p2", 0.0)]
    model = json_tree.text(tree, "camera_model", where) or "OPENCV"
    fisheye = model in _FISHEYE or ("camera_model" not in tree and tree.get("is_fisheye") is True)
    if not fisheye and model not in _PERSPECTIVE:
        known = ", ".join(sorted(_PERSPECTIVE | _FISHEYE))
        raise InputError(f"{where}: camera model {model!r} is not supported (supported: {known}).")
    if fisheye:
        return read_lens("OPENCV_FISHEYE", width, height, (*pinhole, *k), where, findings)
    if k[3] != 0:
        raise InputError(f"{where}: 'k4' of a perspective camera is not supported; undistort the images first.")
    if k[2] != 0:
        return read_lens("FULL_OPENCV", width, height, (*pinhole, k[0], k[1], *p, k[2], 0, 0, 0), where, findings)
    if any(k) or any(p):
        return read_lens("OPENCV", width, height, (*pinhole, k[0], k[1], *p), where, findings)
    return read_lens("PINHOLE", width, height, pinhole, where, findings)
