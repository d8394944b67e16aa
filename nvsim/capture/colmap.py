"""Read a COLMAP model: cameras, images, and points3D in binary or text, and rigs and frames.

On rigs (COLMAP 3.12 and later), world-to-camera = (rig-to-camera) (world-to-rig). Like COLMAP, NVSim takes the pose of
an image on a rig from its frame and ignores the pose in the list of images.

Poses in the files are world-to-camera with OpenCV axes (colmap.github.io/format.html). A model has no metric scale.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from nvsim.capture import colmap_binary, colmap_layout, colmap_text
from nvsim.capture.colmap_layout import (
    EXTENSIONS,
    LISTS,
    RIG_LISTS,
    ModelFolder,
    child_folders,
    is_technical,
    is_usual_path,
    model_extension,
    models_in,
    numbered_with,
)
from nvsim.capture.colmap_rows import CameraRow, FrameRow, ImageRow, RigRow
from nvsim.capture.findings import OTHER_MODELS, Findings
from nvsim.capture.pointcloud import read_cloud, usable_cloud
from nvsim.capture.raw import RawCapture, RawFrame, file_size, inverse, natural_order, pose_from_quaternion, read_lens
from nvsim.capture.trajectories import with_rigs
from nvsim.capture.types import Cloud
from nvsim.errors import InputError, value_text
from nvsim.files.reading import reading
from nvsim.geometry.lens import Lens

Pose = NDArray[np.float64]
_SAME = 1e-4  # tolerance of rotation entries, and of a translation relative to its length


@dataclass(frozen=True)
class ImagePose:
    """Pose and rig of one image.

    pose    world-to-camera (4, 4), None if neither its frame nor the list of images gives one
    rig     id of the rig, "" if the rig has a single camera or there is no rig
    moment  id of the frame if the rig has several cameras, otherwise id of the image
    """

    pose: Pose | None
    rig: str
    moment: float


def place_images(
    images: Sequence[ImageRow], rigs: Sequence[RigRow], frames: Sequence[FrameRow], findings: Findings
) -> list[ImagePose]:
    """The placement of each of `images`. If an image is on a frame, its pose comes from the frame and the rig;
    otherwise from the list of images."""
    by_number = {rig.number: rig for rig in rigs}
    numbers = {row.number for row in images}
    on_frame: dict[int, tuple[FrameRow, RigRow]] = {}
    for frame in frames:
        rig = by_number.get(frame.rig)
        if rig is None:
            findings.warning(f"the frame names rig {frame.rig}, which is not listed", frame.where, "it is not used")
            continue
        for number in frame.images:
            on_frame[number] = frame, rig
            if number not in numbers:
                message = f"the frame names image {number}, which is not in the list of images"
                findings.warning(message, frame.where, "the image is not read, as its name is unknown")
    return [_place_image(row, on_frame.get(row.number), findings) for row in images]


def _place_image(row: ImageRow, on: tuple[FrameRow, RigRow] | None, findings: Findings) -> ImagePose:
    where = f"{row.where} ({row.name})"
    pose, rig_name, moment = None, "", float(row.number)
    if on is not None:
        frame, rig = on
        pose = _pose_on(frame, rig, row.camera)
        if len(rig.cameras) > 1:
            rig_name, moment = str(rig.number), float(frame.number)
    if pose is None:
        return ImagePose(pose_from_quaternion(row.quaternion, row.translation, where, findings), rig_name, moment)
    listed = pose_from_quaternion(row.quaternion, row.translation, where, Findings())
    if listed is not None and _poses_differ(listed, pose):
        findings.warning(
            "the pose in the list of images differs from that of the rig's frame",
            where,
            "the pose of the frame is used, as in COLMAP",
        )
    return ImagePose(pose, rig_name, moment)


def _pose_on(frame: FrameRow, rig: RigRow, camera: int) -> Pose | None:
    """World-to-camera (4, 4), None if the frame or the rig has no pose for this camera."""
    world_to_rig = pose_from_quaternion(frame.quaternion, frame.translation, frame.where, Findings())
    rig_to_camera = _mount(rig, camera)
    return None if world_to_rig is None or rig_to_camera is None else rig_to_camera @ world_to_rig


def _poses_differ(one: Pose, other: Pose) -> bool:
    length = max(float(np.linalg.norm(other[:3, 3])), 1.0)
    turned = float(np.abs(one[:3, :3] - other[:3, :3]).max())
    return turned > _SAME or float(np.linalg.norm(one[:3, 3] - other[:3, 3])) > _SAME * length


def _mount(rig: RigRow, camera: int) -> Pose | None:
    """Rig-to-camera (4, 4), None if the rig does not list the camera or its pose."""
    if camera == rig.reference:
        return np.eye(4)
    mount = rig.mounts.get(camera)
    return None if mount is None else pose_from_quaternion(*mount, rig.where, Findings())


_COMPARED = 10  # models whose images are compared
_SAMPLED = 20  # images that are looked for in a folder
_IMAGE_FOLDERS = ("images", "input", "image", "rgb", "")


def find(path: Path) -> Path | None:
    """The folder itself if it or a folder below it holds a model, or the parent of a file named cameras, images or
    points3D. None if there is no model."""
    if path.is_dir():
        return path if models_in(path) else None
    return path.parent if path.stem in (*LISTS, *RIG_LISTS) and model_extension(path.parent) is not None else None


def explain_missing(path: Path) -> str:
    """A sentence about the missing parts of a COLMAP model in a folder, or in the folder of a model's file; "" if it
    does not look like a COLMAP model."""
    if path.is_dir():
        return colmap_layout.missing_from_model(path)
    return colmap_layout.missing_from_model(path.parent) if path.stem in (*LISTS, *RIG_LISTS) else ""


def read(root: Path, findings: Findings) -> RawCapture:
    """The capture of the model in or below `root`, the folder that the user named.

    Of several numbered models, the one with the most images is read. Images are searched in `images` beside the model
    and up to three folders above it. Raises InputError if there is no model or a file cannot be parsed."""
    models = models_in(root)
    if not models:
        raise InputError(f"{root} holds no COLMAP model; it needs cameras and images as .bin or .txt.")
    model, rows = _choose_model(models, root, findings)
    reader = _reader(model)
    with _reading(model, "cameras") as path:
        cameras = reader.read_cameras(path)
    lenses = {camera.number: _lens(camera, findings) for camera in cameras}
    folder = _image_folder(model.folder, root, rows)
    frames = []
    for row, placement in zip(rows, _placements(model, rows, findings), strict=True):
        where = f"{row.where} ({row.name})"
        if row.camera not in lenses:
            findings.error(f"the image names camera {row.camera}, which is not listed", where, "it has no lens")
        frames.append(
            RawFrame(
                row.name,
                folder / row.name,
                lenses.get(row.camera),
                None if placement.pose is None else inverse(placement.pose),
                where,
                str(row.camera),
                placement.moment,
                rig=placement.rig,
            )
        )
    frames.sort(key=lambda f: natural_order(f.name))
    if not any(frame.rig for frame in frames):
        frames = with_rigs(frames, [frame.name.partition("/")[2] for frame in frames])
    return RawCapture(root, "colmap", tuple(frames), _cloud(model, findings), metric=False)


def _choose_model(models: list[ModelFolder], root: Path, findings: Findings) -> tuple[ModelFolder, list[ImageRow]]:
    """The model to read, and its images. Of the models that the mapper wrote together, it is the one with the most
    images. A finding names the other models if they contain further images. Raises InputError if the model cannot be
    read."""
    together = numbered_with(models[0], models)
    lists: dict[ModelFolder, list[ImageRow] | InputError] = {}
    for model in dict.fromkeys([*together, *models[:_COMPARED], *_other_numbered_models(models[0], root)]):
        try:
            with _reading(model, "images") as path:
                lists[model] = _reader(model).read_images(path)
        except InputError as error:
            lists[model] = error
    readable = {model: rows for model in together if not isinstance(rows := lists[model], InputError)}
    if not readable:
        rows = lists[models[0]]
        assert isinstance(rows, InputError)
        raise rows
    chosen = max(readable, key=lambda model: len(readable[model]))
    if not is_usual_path(chosen):
        findings.note(
            "the COLMAP model is in an unusual folder", value_text(chosen.name), "name that folder to be sure"
        )
    names = {row.name for row in readable[chosen]}
    further = [m for m, rows in lists.items() if isinstance(rows, InputError) or {row.name for row in rows} - names]
    if further:
        parts = [_words(model, rows, model == chosen) for model, rows in lists.items() if model in (chosen, *further)]
        if chosen.folder == root:  # the user named this model
            findings.note(OTHER_MODELS, ", ".join(parts), "only the images of the model that you named are used")
        else:
            findings.warning(
                OTHER_MODELS,
                ", ".join(parts),
                f"the images of one model are used; --model {further[0].name} selects another",
            )
    return chosen, readable[chosen]


def _words(model: ModelFolder, rows: list[ImageRow] | InputError, is_read: bool) -> str:
    if isinstance(rows, InputError):
        return f"{_shown_name(model)} (cannot be read: {value_text(str(rows).rstrip('.'))})"
    return f"{_shown_name(model)} ({len(rows)} image{'' if len(rows) == 1 else 's'}{', read' if is_read else ''})"


def _shown_name(model: ModelFolder) -> str:
    return value_text(f"{model.folder.parent.name}/{model.folder.name}" if model.name == "." else model.name)


def _other_numbered_models(model: ModelFolder, root: Path) -> list[ModelFolder]:
    """The other numbered models beside `model`, if the user named a numbered model directly."""
    if model.folder != root or not root.name.isdigit():
        return []
    others = [folder for folder in child_folders(root.parent) if folder.name.isdigit() and folder != root]
    found = [(folder, model_extension(folder)) for folder in others[:_COMPARED]]
    return [
        ModelFolder(folder, kind, f"{root.parent.name}/{folder.name}") for folder, kind in found if kind is not None
    ]


def _reader(model: ModelFolder) -> ModuleType:
    return colmap_binary if model.extension == ".bin" else colmap_text


@contextmanager
def _reading(model: ModelFolder, stem: str) -> Iterator[Path]:
    """The path of a model file. Errors while reading it in this context become InputError."""
    path = model.folder / f"{stem}{model.extension}"
    with reading(path, f"a list of COLMAP {stem}"):
        yield path


def _lens(camera: CameraRow, findings: Findings) -> Lens | None:
    name, params = camera.model, camera.params
    if name == "SIMPLE_FISHEYE" and len(params) == 3:  # both equal OPENCV_FISHEYE without distortion
        name, params = "OPENCV_FISHEYE", (params[0], *params, 0.0, 0.0, 0.0, 0.0)
    elif name == "FISHEYE" and len(params) == 4:
        name, params = "OPENCV_FISHEYE", (*params, 0.0, 0.0, 0.0, 0.0)
    return read_lens(name, camera.width, camera.height, params, camera.where, findings)


def _placements(model: ModelFolder, rows: list[ImageRow], findings: Findings) -> list[ImagePose]:
    """The placement of each image. It follows rigs and frames if the model has both lists."""
    if any(file_size(model.folder / f"{stem}{model.extension}") is None for stem in RIG_LISTS):
        return place_images(rows, (), (), findings)
    with _reading(model, "rigs") as path:
        rigs = _reader(model).read_rigs(path)
    with _reading(model, "frames") as path:
        frames = _reader(model).read_frames(path)
    return place_images(rows, rigs, frames, findings)


def _cloud(model: ModelFolder, findings: Findings) -> Cloud | None:
    """The points of points3D.bin or .txt, or of a PLY file instead. Raises InputError if they cannot be read."""
    cloud = None
    for extension in (model.extension, *(x for x in EXTENSIONS if x != model.extension)):
        other = ModelFolder(model.folder, extension, model.name)
        if file_size(model.folder / f"points3D{extension}") is not None:
            with _reading(other, "points3D") as path:
                xyz, rgb = _reader(other).read_points(path)
            cloud = usable_cloud(xyz, rgb, "sfm", path.name, findings)
            if len(cloud.points):
                return cloud
    clouds = sorted(p for p in model.folder.iterdir() if p.suffix.lower() == ".ply" and file_size(p) is not None)
    named = [path for path in clouds if path.stem.lower() == "points3d"]
    if not named and len(clouds) == 1:
        named = clouds
        findings.note("the model has no points3D", model.name, f"the points of {clouds[0].name} are used")
    return read_cloud(named[0], findings, kind="sfm") if named else cloud


def _image_folder(model: Path, root: Path, rows: list[ImageRow]) -> Path:
    """The folder that holds most of the first images, or `root/images` if no folder holds any.

    The search goes up to the second folder above the model whose name is not technical. For colmap/sparse/0, this is
    the parent of the capture."""
    named = [folder for folder in model.parents if not is_technical(folder)]
    above = len(model.parts) - len(named[1].parts) if len(named) > 1 else 3
    bases = [model, *model.parents[: max(3, above)]]
    found = {
        folder: sum(file_size(folder / row.name) is not None for row in rows[:_SAMPLED])
        for folder in (base / sub for base in bases for sub in _IMAGE_FOLDERS)
    }
    best = max(found, key=lambda folder: found[folder])
    return best if found[best] else root / "images"
