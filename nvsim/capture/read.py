"""Read and align a capture of any format. It writes no files.

Large coordinates (UTM, ECEF, site grids) lose an origin in double precision: four million meters from the origin,
float32 has steps of 0.25 m. `Alignment.origin` stores the subtracted origin. Exports in the capture's own frame add it
again.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.alignment import align, apply
from nvsim.capture.axes import Axes, with_axes
from nvsim.capture.black_borders import cut_black_borders
from nvsim.capture.colmap_layout import model_extension
from nvsim.capture.excluded_frames import without_frames
from nvsim.capture.findings import IMAGE_AMBIGUOUS, IMAGE_MISSING, Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.image_folder import find_moved_images, resolve_images_in
from nvsim.capture.images import image_header, is_turned
from nvsim.capture.masks import with_masks_beside
from nvsim.capture.raw import FAR, LOST_FRAME, RawCapture, RawFrame, file_size
from nvsim.capture.types import Alignment, Capture, Cloud
from nvsim.capture.upright import turn_upright
from nvsim.errors import value_text
from nvsim.files.placeholders import why_missing
from nvsim.geometry.lens import Lens
from nvsim.plain_text import count_text

_ROUND = 100.0  # source units; the origin is a multiple
_TIMES = 3.0  # extents of the trajectory; a nearer origin occurs in large captures and in fine units
_MAP = 1e5  # source units; larger coordinates are of a map projection or of the earth, in meters
_COARSE = 0.005  # source units; float32 steps that are too coarse for a floor


def subtract_origin(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` with an origin subtracted from its poses, point cloud, LiDAR scans, and depth images; a note reports it.

    The origin is rounded. It is subtracted if the cameras are more than 1000 units from the source's origin. The point
    cloud becomes float32 in any case."""
    positions = np.array([f.camera_to_world[:3, 3] for f in raw.frames if f.camera_to_world is not None])
    origin = _origin_of(positions)
    if not np.any(origin):
        return replace(raw, cloud=_shifted_cloud(raw.cloud, origin))
    words = ", ".join(f"{v:.0f}" for v in origin)
    findings.note(
        f"the coordinates are far from the origin, so ({words}) is subtracted",
        raw.source.name,
        "32-bit numbers are too coarse there; exports in the capture's frame add it again",
    )
    if raw.cloud is not None and len(raw.cloud.points):
        points = raw.cloud.points
        step = float(np.spacing(np.float32(np.abs(points).max())))
        if step > _COARSE and np.array_equal(points, points.astype(np.float32)):
            findings.warning(
                f"the cloud was written as 32-bit numbers, whose steps are {step:.3g} units so far from the origin",
                raw.source.name,
                "its surfaces are that coarse; export it with 64-bit coordinates or nearer to the origin",
            )
    claims = raw.metric or bool(np.abs(origin).max() >= _MAP)
    return replace(
        raw,
        frames=tuple(
            f if f.camera_to_world is None else replace(f, camera_to_world=_shift_places(f.camera_to_world, origin))
            for f in raw.frames
        ),
        cloud=_shifted_cloud(raw.cloud, origin),
        scans=tuple(replace(s, to_world=_shift_places(s.to_world, origin)) for s in raw.scans),
        depths=tuple(replace(d, camera_to_world=_shift_places(d.camera_to_world, origin)) for d in raw.depths),
        metric=claims,
        metric_because=raw.metric_because if raw.metric else "the coordinates are map coordinates" if claims else "",
        origin=(float(origin[0]), float(origin[1]), float(origin[2])),
    )


def _origin_of(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) multiples of 100 source units near the cameras (N, 3). An axis is 0 if the cameras are near the origin on
    it."""
    if not len(positions):
        return np.zeros(3)
    middle = np.median(positions, axis=0)
    extent = float(np.ptp(np.quantile(positions, [0.05, 0.95], axis=0), axis=0).max())
    if np.abs(middle).max() <= max(FAR, _TIMES * extent):
        return np.zeros(3)
    return np.where(np.abs(middle) > FAR, np.round(middle / _ROUND) * _ROUND, 0.0)


def _shift_places(pose: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.float64]:
    moved = pose.copy()
    moved[:3, 3] -= origin
    return moved


def _shifted_cloud(cloud: Cloud | None, origin: NDArray[np.float64]) -> Cloud | None:
    if cloud is None or (cloud.points.dtype == np.float32 and not np.any(origin)):
        return cloud
    return replace(cloud, points=(cloud.points.astype(np.float64) - origin).astype(np.float32))


_FEW = 3  # sizes that are listed one by one
_ABOVE = 3  # folders above an image in which another model is searched
_ALIKE = (0.9, 1.1)  # ratios of images that undistortion cropped or padded rather than scaled


def fit_lenses(raw: RawCapture, findings: Findings) -> RawCapture:
    """`raw` with the lens of each frame scaled to the size of its image.

    A lens is scaled if its aspect ratio equals that of the image within a pixel (images_2, images_4). Notes list the
    scaled sizes, and the number of images that their orientation tag rotates when they are read. Other sizes are kept;
    the image decoder rejects them. Images of another size in the folder of another COLMAP model are an error: programs
    write such a model with undistorted images, whose lenses differ."""
    scaled: Counter[tuple[Lens, Lens]] = Counter()
    models: dict[Path, Path | None] = {}  # of the images in a folder, if it is another model
    of_other_models: Counter[Path] = Counter()
    turned = 0
    frames = []
    for frame in raw.frames:
        header = None if frame.lens is None else image_header(frame.image_path)
        if frame.lens is None or header is None:
            frames.append(frame)
            continue
        width, height, orientation = header
        lens = frame.lens
        if sorted((width, height)) != sorted((lens.width, lens.height)):
            place = frame.image_path.parent
            other = models[place] = models[place] if place in models else _other_model(place, raw)
            if other is not None:
                of_other_models[other] += 1
                frames.append(frame)
                continue
        for size in ((width, height), (height, width)):
            if size == (width, height) or is_turned((width, height), orientation, size):
                fitting = lens if size == (lens.width, lens.height) else _resize_lens(lens, *size)
                if fitting is not None:
                    turned += size != (width, height)
                    if fitting is not lens:
                        scaled[lens, fitting] += 1
                    lens = fitting
                    break
        frames.append(frame if lens is frame.lens else replace(frame, lens=lens))
    _report_scaled(scaled, raw.source.name, findings)
    for folder, count in of_other_models.items():
        has, lies = ("has", "lies") if count == 1 else ("have", "lie")
        findings.error(
            f"{count_text(count, 'image')} {has} another size than the camera and {lies} beside another COLMAP model",
            value_text(folder),
            f"this model was probably written with the undistorted images; import {value_text(folder)} instead",
        )
    if turned:
        findings.note(
            f"{turned} images fit their camera only after the rotation in their orientation tag",
            raw.source.name,
            "they are rotated when they are read; other orientation tags are ignored",
        )
    return replace(raw, frames=tuple(frames))


def _report_scaled(scaled: Counter[tuple[Lens, Lens]], where: str, findings: Findings) -> None:
    """Notes the sizes of scaled images, those of one camera in one note if there are many. `scaled`: the lenses of the
    camera and of the images -> number of images."""
    sizes: dict[tuple[int, int], Counter[tuple[int, int]]] = {}
    for (lens, fitting), count in scaled.items():
        sizes.setdefault((lens.width, lens.height), Counter())[fitting.width, fitting.height] += count
    for (width, height), counts in sizes.items():
        camera = f"the camera is {width}x{height}"
        if len(counts) > _FEW:
            least, *_, most = sorted(w / width for w, _ in counts)
            sizes_text = f"{count_text(sum(counts.values()), 'image')} have {len(counts)} sizes and {camera}"
            findings.note(sizes_text, where, f"the camera is scaled to each image, by {least:.4g} to {most:.4g}")
            continue
        for (w, h), count in counts.items():
            images = f"{count_text(count, 'image')} {'is' if count == 1 else 'are'} {w}x{h} pixels and {camera}"
            findings.note(images, where, f"the camera is scaled to the images, by {w / width:.4g}")


def _other_model(folder: Path, raw: RawCapture) -> Path | None:
    """The folder with the COLMAP model of the images in `folder`, if that is not the model of `raw`. None otherwise."""
    source = raw.source.resolve()
    for above in folder.resolve().parents[:_ABOVE]:
        if any(model_extension(above / name) for name in ("sparse", "sparse/0")):
            return None if source.is_relative_to(above) else above
    return None


def _resize_lens(lens: Lens, width: int, height: int) -> Lens | None:
    """`lens` for images of `width` x `height` pixels; None if the two sides have different scales."""
    across, down = width / lens.width, height / lens.height
    if _ALIKE[0] < across < _ALIKE[1]:
        return None
    if abs(height - across * lens.height) > 1 and abs(width - down * lens.width) > 1:
        return None
    return lens.resized(width, height)


def read(
    path: Path,
    *,
    scale: float | None = None,
    camera_height: float | None = None,
    alignment: Alignment | None = None,
    leave_out: str = "",
    images: str = "",
    axes: Axes = "auto",
    model: str = "",
) -> Capture:
    """The capture at `path`, a folder or a file of it, in the aligned frame.

    scale          meters per unit of the source, if the source does not state it
    camera_height  meters of the cameras above the floor; gives the scale of a source without one
    alignment      a known alignment; nothing is estimated then
    leave_out      names of frames to leave out, separated by commas
    images         folder in which missing images are searched, "" for none
    axes           convention of the poses in the files
    model          which of several COLMAP models, by its folder; "" for the one with the most images

    A capture of unknown scale is loaded with `alignment.scale_known` False. Raises InputError that lists every error,
    including missing and empty images. Images are not decoded; `check` does that.
    """
    findings = Findings()
    raw = with_axes(read_usable(path, leave_out, images, findings, model), axes)
    for frame in raw.frames:
        report_absent_image(frame, findings)
    findings.raise_errors(path)
    raw = turn_upright(cut_black_borders(raw, findings), findings, None if alignment is None else alignment.rotation[2])
    if alignment is None:
        alignment, _ = align(raw, scale, camera_height, findings)
    return apply(raw, alignment)


def read_usable(path: Path, leave_out: str, images: str, findings: Findings, model: str = "") -> RawCapture:
    """The capture at `path` before alignment, as `check` and `read` use it. `model` selects one of several COLMAP
    models.

    Frames named in `leave_out` are removed, moved files are found, lenses are fitted to the sizes of their images, and
    a far origin is subtracted. Raises InputError if nothing can be read."""
    raw = resolve_images_in(without_frames(read_raw(path, findings, model), leave_out, findings), images)
    raw = with_masks_beside(find_moved_images(raw, findings))
    raw = fit_lenses(raw, findings)
    return subtract_origin(raw, findings)


def report_absent_image(frame: RawFrame, findings: Findings) -> bool:
    """Whether the image is missing or empty; if so, adds an error finding."""
    size = file_size(frame.image_path)
    if size is None and frame.choices:
        folders = ", ".join(value_text(folder) for folder in frame.choices[:4])
        findings.error(IMAGE_AMBIGUOUS, frame.where, f"{LOST_FRAME}; found in {folders}")
    elif size is None:
        why = why_missing(frame.image_path)
        looked = f"{LOST_FRAME}; looked for {value_text(frame.image_path)}" + (f", which {why}" if why else "")
        below = f", and for its name below {value_text(frame.root)}" if frame.root is not None else ""
        findings.error(IMAGE_MISSING, frame.where, f"{looked}{below}; --images FOLDER names another place")
    elif size == 0:
        findings.error("the image is empty (0 bytes)", frame.where, LOST_FRAME)
    return not size
