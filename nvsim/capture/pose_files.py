"""Read captures that have a file for each pose: raw exports of Polycam, and recordings of a depth camera in the layouts
of 7-Scenes and 3DMatch (frame-000000.color.png, .depth.png, .pose.txt) and of ScanNet (color/0.jpg, depth/0.png,
pose/0.txt).

Poses are camera-to-world in meters. Polycam's have OpenGL axes in a world with y up, the others OpenCV axes. Depth
images are 16-bit PNG files in millimeters. Formats: https://github.com/PolyCam/polyform and the pages of the datasets.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import nerfstudio_fields
from nvsim.capture.findings import Findings
from nvsim.capture.raw import (
    LOST_FRAME,
    RawCapture,
    RawFrame,
    checked_pose,
    natural_order,
    read_lens,
    read_text,
    size_of_lens,
)
from nvsim.capture.types import DepthFile
from nvsim.errors import InputError, value_text
from nvsim.geometry.lens import Lens

_POSE, _COLOR, _DEPTH = ".pose.txt", ".color", ".depth"
_COLORS, _POSES, _DEPTHS = ("color", "rgb"), ("pose", "poses"), "depth"
_IMAGES = (".jpg", ".jpeg", ".png", ".JPG", ".PNG")
_INTRINSICS = (
    *("camera-intrinsics.txt", "camera_intrinsics.txt", "intrinsic/intrinsic_color.txt", "intrinsic_color.txt"),
    *("intrinsics.txt", "intrinsic.txt"),
)
_DEPTH_INTRINSICS = ("intrinsic/intrinsic_depth.txt", "intrinsic_depth.txt")
_KINECT_SIZE, _KINECT_COLOR, _KINECT_DEPTH = (640, 480), 525.0, 585.0  # pixels; 7-Scenes states the depth camera's
_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_Y_UP_TO_Z_UP = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
_CAMERAS = (("corrected_cameras", ("corrected_images", "images")), ("cameras", ("images",)))
_MILLIMETER = 0.001


def find_polycam(path: Path) -> Path | None:
    """The folder `keyframes` of a raw export of Polycam, if `path` is the export or this folder; otherwise None."""
    for folder in (path / "keyframes", path):
        if folder.name == "keyframes" and _polycam_folders(folder) is not None:
            return folder
    return None


def _polycam_folders(keyframes: Path) -> tuple[Path, Path] | None:
    """The folders of the poses and of the images: the optimized ones if both are there."""
    for cameras, choices in _CAMERAS:
        for images in choices:
            if (keyframes / cameras).is_dir() and (keyframes / images).is_dir():
                return keyframes / cameras, keyframes / images
    return None


def explain_missing_polycam(folder: Path) -> str:
    """A sentence about a folder with keyframes of Polycam that lacks its poses or images; "" for other folders."""
    keyframes = folder / "keyframes"
    if not keyframes.is_dir() or find_polycam(folder) is not None:
        return ""
    return f"{value_text(keyframes)} lacks the folder cameras or images of a raw export of Polycam; export it again."


def read_polycam(keyframes: Path, findings: Findings) -> RawCapture:
    """The capture of a raw export of Polycam.

    The optimized poses are read if there are any. Depth with the lowest confidence is ignored. Frames with an unusable
    file are errors in `findings`. Raises InputError if there is no pose."""
    folders = _polycam_folders(keyframes)
    assert folders is not None  # find_polycam has tested it
    cameras, images = folders
    if cameras.name == "cameras":
        findings.warning(
            "the export has no optimized poses (corrected_cameras)",
            keyframes.name,
            "the poses of ARKit drift; process the scan again with loop closure, or use --poses refined",
        )
    files = files_by_stem(images)
    frames: list[RawFrame] = []
    depths: list[DepthFile] = []
    stems = _sorted_stems(cameras, ".json")
    for stem in stems:
        where = f"{cameras.name}/{stem}.json"
        try:
            tree = nerfstudio_fields.load_object(cameras / f"{stem}.json")
            fields = {key: _required(tree, key, where) for key in ("fx", "fy", "cx", "cy", "width", "height")}
            rows = [[_required(tree, f"t_{i}{j}", where) for j in range(4)] for i in range(3)]
        except InputError as error:
            findings.error(str(error).removeprefix(f"{where}: ").rstrip("."), where, LOST_FRAME)
            continue
        pinhole = [fields[key] for key in ("fx", "fy", "cx", "cy")]
        lens = read_lens("PINHOLE", fields["width"], fields["height"], pinhole, where, findings)
        pose = checked_pose(np.array([*rows, [0, 0, 0, 1.0]]), where, findings)
        placed = None if pose is None else _Y_UP_TO_Z_UP @ pose @ _TO_OPENCV
        image = files.get(stem, images / f"{stem}.jpg")
        at = float(stem) / 1e6 if stem.isdecimal() else float(len(frames))
        frame = RawFrame(f"{images.name}/{image.name}", image, lens, placed, where, timestamp=at, axes="opengl")
        frames.append(frame)
        confidence = keyframes / "confidence" / f"{stem}.png"
        depths += _depth(keyframes / "depth" / f"{stem}.png", lens, frame, confidence)
    if not stems:
        raise InputError(f"{cameras} holds no poses (TIMESTAMP.json); export the scan again.")
    return RawCapture(keyframes, "polycam", tuple(frames), None, True, (), tuple(depths))


def _required(tree: nerfstudio_fields.Tree, key: str, where: str) -> float:
    value = nerfstudio_fields.number(tree, key, where)
    if value is None:
        raise InputError(f"{where}: the field {key!r} is missing; export the scan again.")
    return value


def find_depth_recording(path: Path) -> Path | None:
    """`path` if it is a recording of a depth camera with a text file for each pose; otherwise None."""
    if not path.is_dir():
        return None
    try:
        names = os.listdir(path)
    except OSError:
        return None
    if any(name.endswith(_POSE) for name in names):
        return path
    pose, color = _child(path, _POSES, names), _child(path, _COLORS, names)
    return path if pose is not None and color is not None and _sorted_stems(pose, ".txt") else None


def _child(folder: Path, choices: tuple[str, ...], names: list[str]) -> Path | None:
    return next((folder / name for name in choices if name in names and (folder / name).is_dir()), None)


def read_depth_recording(folder: Path, findings: Findings) -> RawCapture:
    """The capture of a recording with color images, depth images, and a 4x4 matrix for each pose.

    Frames whose tracking was lost (their matrix is not finite) are warnings. Raises InputError if the intrinsics are
    missing or unusable."""
    names = os.listdir(folder)
    if any(name.endswith(_POSE) for name in names):
        poses = {name.removesuffix(_POSE): folder / name for name in names if name.endswith(_POSE)}
        colors, depths = (files_by_stem(folder, mark) for mark in (_COLOR, _DEPTH))
        prefix, missing = "", f"{_COLOR}.png"
    else:
        pose, color = _child(folder, _POSES, names), _child(folder, _COLORS, names)
        assert pose is not None and color is not None  # find_depth_recording has tested it
        poses = {stem: pose / f"{stem}.txt" for stem in _sorted_stems(pose, ".txt")}
        colors, depths = files_by_stem(color), files_by_stem(folder / _DEPTHS)
        prefix, missing = f"{color.name}/", ".jpg"
    lens, depth_lens = read_lenses(folder, colors, depths, findings)
    frames: list[RawFrame] = []
    found: list[DepthFile] = []
    for index, stem in enumerate(sorted(poses, key=natural_order)):
        image = colors.get(stem, folder / f"{prefix}{stem}{missing}")
        where = poses[stem].relative_to(folder).as_posix()
        matrix = _pose(poses[stem], where, findings)
        frame = RawFrame(f"{prefix}{image.name}", image, lens, matrix, where, timestamp=float(index))
        frames.append(frame)
        if stem in depths:
            found += _depth(depths[stem], depth_lens, frame)
    return RawCapture(folder, "depth recording", tuple(frames), None, True, (), tuple(found))


def _depth(file: Path, lens: Lens | None, frame: RawFrame, confidence: Path | None = None) -> list[DepthFile]:
    """The depth image of a frame if its file, its lens, and the pose exist."""
    if lens is None or frame.camera_to_world is None or not file.is_file():
        return []
    known = confidence if confidence is not None and confidence.is_file() else None
    return [DepthFile(file, lens, frame.camera_to_world, frame.name, unit=_MILLIMETER, confidence=known)]


def _pose(file: Path, where: str, findings: Findings) -> NDArray[np.float64] | None:
    try:
        values = _matrix(file, 4)
    except InputError as error:
        findings.error(str(error).replace(str(file), "the pose file").rstrip("."), where, LOST_FRAME)
        return None
    if not np.isfinite(values).all():
        findings.warning("the tracking was lost (the pose is not finite)", where, "the frame is skipped")
        return None
    return checked_pose(values, where, findings)


def _matrix(file: Path, size: int) -> NDArray[np.float64]:
    """The (size, size) float64 matrix in a text file, which may have further rows and columns. Raises InputError if
    the file holds no such matrix."""
    rows = [line.replace(",", " ").split() for line in read_text(file).splitlines() if line.strip()]
    try:
        return np.array([[float(word) for word in row[:size]] for row in rows[:size]]).reshape(size, size)
    except ValueError:
        raise InputError(f"{file} holds no {size}x{size} matrix of numbers; write it again.") from None


def read_lenses(
    folder: Path, colors: dict[str, Path], depths: dict[str, Path], findings: Findings
) -> tuple[Lens | None, Lens | None]:
    """The lenses of the color camera and of the depth camera, which is the same unless it has its own intrinsics.
    `colors` and `depths` are image files of the recording in `folder` by name. Raises InputError if there are no
    intrinsics and the images are not those of a Kinect."""
    from nvsim.capture.images import image_size  # imports OpenCV, which slows down the start of the app

    if not colors:
        raise InputError(f"{folder} holds poses but no color images; copy them there.")
    size = image_size(next(iter(colors.values())))
    file = intrinsics_file(folder)
    if file is not None:
        lens = _lens(file, size, findings)
        own = _first_file(folder, _DEPTH_INTRINSICS)
        if own is None or not depths:
            return lens, lens
        return lens, _lens(own, image_size(next(iter(depths.values()))), findings)
    if size != _KINECT_SIZE:
        raise InputError(f"{folder} has no intrinsics (the 3x3 matrix camera-intrinsics.txt); add this file.")
    findings.warning(
        "the intrinsics are assumed to be those of a Kinect, as in 7-Scenes",
        value_text(folder.name),
        "if the camera is another one, add its 3x3 matrix as camera-intrinsics.txt",
    )
    return _kinect(_KINECT_COLOR), _kinect(_KINECT_DEPTH)


def _kinect(focal: float) -> Lens:
    width, height = _KINECT_SIZE
    return Lens("PINHOLE", width, height, (focal, focal, width / 2, height / 2))


def intrinsics_file(folder: Path) -> Path | None:
    """The file with the intrinsic matrix of the recordings in `folder`, or None."""
    return _first_file(folder, _INTRINSICS)


def _first_file(folder: Path, choices: tuple[str, ...]) -> Path | None:
    """The first of `choices` in `folder` or in the folder above it, which may hold several recordings."""
    return next((at / name for at in (folder, folder.parent) for name in choices if (at / name).is_file()), None)


def _lens(file: Path, size: tuple[int, int], findings: Findings) -> Lens | None:
    """The lens of an intrinsic matrix for an image of `size` (width, height)."""
    k = _matrix(file, 3)
    if not np.isfinite(k).all():
        raise InputError(f"{file} holds a value that is not a finite number; write it again.")
    center = float(k[0, 2]), float(k[1, 2])
    return read_lens("PINHOLE", *size_of_lens(size, center), (k[0, 0], k[1, 1], *center), file.name, findings)


def files_by_stem(folder: Path, mark: str = "") -> dict[str, Path]:
    """Images in `folder`, by their names without the extension and without `mark` before it."""
    found: dict[str, Path] = {}
    if not folder.is_dir():
        return found
    for name in sorted(os.listdir(folder)):
        stem, ending = os.path.splitext(name)
        if ending in _IMAGES and stem.endswith(mark) and not name.startswith("."):
            found.setdefault(stem.removesuffix(mark), folder / name)
    return found


def _sorted_stems(folder: Path, ending: str) -> list[str]:
    names = [name for name in os.listdir(folder) if name.endswith(ending) and not name.startswith(".")]
    return sorted((name.removesuffix(ending) for name in names), key=natural_order)
