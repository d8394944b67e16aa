"""A COLMAP model: cameras, images, points3D in binary or text, and the folder of images beside it.

Poses in the files are world-to-camera with OpenCV axes (colmap.github.io/format.html). A model has no metric scale.
"""

from __future__ import annotations

from pathlib import Path

from nvsim.capture import colmap_binary, colmap_text
from nvsim.capture.colmap_rows import ImageRow
from nvsim.capture.findings import Findings
from nvsim.capture.lens_reading import read_lens
from nvsim.capture.pointcloud import usable_cloud
from nvsim.capture.raw import RawCapture, RawFrame, file_size, inverse, pose_from_quaternion
from nvsim.errors import InputError
from nvsim.files.reading import reading

_LISTS = ("cameras", "images", "points3D")


def model_extension(folder: Path) -> str | None:
    """ ".bin" or ".txt" when `folder` holds cameras and images of that kind (binary first), otherwise None."""
    for extension in (".bin", ".txt"):
        if all(file_size(folder / f"{stem}{extension}") is not None for stem in ("cameras", "images")):
            return extension
    return None


def find_model(folder: Path) -> Path | None:
    """The model in or under `folder` (itself, sparse/0, sparse, colmap/sparse/0, ...); of several numbered models the
    one with the largest image list, because COLMAP numbers them as they come."""
    for base in (folder, folder / "sparse", folder / "colmap" / "sparse", folder / "distorted" / "sparse"):
        if model_extension(base) is not None:
            return base
        numbered = [base / str(i) for i in range(20) if model_extension(base / str(i)) is not None]
        if numbered:
            return max(numbered, key=lambda m: file_size(m / f"images{model_extension(m)}") or 0)
    return None


def find(path: Path) -> Path | None:
    """The folder itself where a model lies in or under it; the folder of a file cameras, images or points3D."""
    if path.is_dir():
        return None if find_model(path) is None else path
    return path.parent if path.stem in _LISTS and model_extension(path.parent) is not None else None


def read(root: Path, findings: Findings) -> RawCapture:
    """The capture of the model in or under `root`, the folder that the user named; images are looked for in `images`
    beside the model and up to three folders above it. Raises InputError when a file cannot be parsed."""
    model = find_model(root)
    extension = None if model is None else model_extension(model)
    if model is None or extension is None:
        raise InputError(f"{root} holds no COLMAP model; it needs cameras and images as .bin or .txt.")
    reader = colmap_binary if extension == ".bin" else colmap_text
    lenses = {}
    with reading(model / f"cameras{extension}", "a list of COLMAP cameras"):
        cameras = reader.read_cameras(model / f"cameras{extension}")
    for camera in cameras:
        lenses[camera.number] = read_lens(
            camera.model, camera.width, camera.height, camera.params, camera.where, findings
        )
    with reading(model / f"images{extension}", "a list of COLMAP images"):
        rows = reader.read_images(model / f"images{extension}")
    folder = _image_folder(model, root, rows)
    frames = []
    for row in rows:
        where = f"{row.where} ({row.name})"
        pose = pose_from_quaternion(row.quaternion, row.translation, where, findings)
        if row.camera not in lenses:
            findings.error(f"the image names camera {row.camera}, which is not listed", where, "it has no lens")
        frames.append(
            RawFrame(
                row.name,
                folder / row.name,
                lenses.get(row.camera),
                None if pose is None else inverse(pose),
                where,
                str(row.camera),
                float(row.number),
            )
        )
    frames.sort(key=lambda f: f.name)
    points = model / f"points3D{extension}"
    cloud = None
    if file_size(points) is not None:
        with reading(points, "a list of COLMAP points"):
            xyz, rgb = reader.read_points(points)
        cloud = usable_cloud(xyz, rgb, "sfm", points.name, findings)
    return RawCapture(root, "colmap", tuple(frames), cloud, metric=False)


def _image_folder(model: Path, root: Path, rows: list[ImageRow]) -> Path:
    """The first folder that has one of the first images; `root/images` when none has."""
    bases = [model, *model.parents[:3]]  # sparse/0 lies two below the images, colmap/sparse/0 three
    for folder in [b / sub for b in bases for sub in ("images", "input", "")]:
        if any(file_size(folder / row.name) is not None for row in rows[:20]):
            return folder
    return root / "images"
