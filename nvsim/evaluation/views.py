"""Score the models' renders on held-out frames and on the novel views of a ground truth, at full size.

Frame number hold_out // 2 and every hold_out-th frame after it are held out (hold_out 8 by default: frames 4, 12, 20,
...). They are not used in training or for the support of the floor. Metrics are computed per frame and averaged over
frames. If the ground truth has transient masks, pixels of people are ignored, because they cannot be predicted.

The novel views of a ground truth are images away from the trajectory and with other headings, with poses:

FOLDER/holdout_frames.txt   "# PINHOLE width height fx F fy F cx C cy C", then a line per view: its image and the
                            16 numbers of the row-major camera-to-world pose (OpenCV axes, frame of the capture)
FOLDER/novel/NAME.png       the images
FOLDER/novel_floor/NAME.png true floor masks, 255 on floor; may be missing
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.alignment import to_aligned_frame
from nvsim.capture.images import decode, read_image
from nvsim.capture.masks import usable_pixels
from nvsim.capture.types import Alignment
from nvsim.errors import InputError
from nvsim.evaluation.scores import (
    LEAST_PIXELS,
    Distance,
    Image,
    Mask,
    Scores,
    mean_scores,
    psnr,
    rounded_metrics,
    score,
)
from nvsim.evaluation.truth import read_true_mask, true_mask, truth_of
from nvsim.events import Listener, Progress, ignore_event
from nvsim.files.atomic import make_folder, write_bytes
from nvsim.files.opening import is_regular, read_text
from nvsim.geometry.camera import Camera, Intrinsics
from nvsim.perception.segment import read_mask
from nvsim.project.config import held_out
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config
from nvsim.project.work import missing_result_error
from nvsim.render.scene import render_scene

LISTING = "holdout_frames.txt"
_LONGEST = 64 << 20  # bytes of the listing
STEEP = -0.35
"""Largest z of a unit ray direction that counts as steeply down, about 20 degrees below the horizon."""
_PINHOLE = re.compile(r"#\s*PINHOLE\s+(\d+)\s+(\d+)\s+fx\s+(\S+)\s+fy\s+(\S+)\s+cx\s+(\S+)\s+cy\s+(\S+)")


@dataclass(frozen=True, eq=False)
class NovelView:
    """name without folder and suffix; camera in the aligned frame; floor: mask file, None if there is none."""

    name: str
    camera: Camera
    picture: Path
    floor: Path | None

    def image(self) -> NDArray[np.float32]:
        """(H, W, 3) float32, 0 to 1. Raises InputError if the image cannot be read or has another size."""
        image = decode(self.picture)
        k = self.camera.intrinsics
        if image.shape[:2] != (k.height, k.width):
            raise InputError(
                f"{self.picture} has {image.shape[1]}x{image.shape[0]} pixels but {LISTING} says {k.width}x{k.height}; "
                "render it again at that size."
            )
        return (image / np.float32(255)).astype(np.float32)

    def floor_mask(self) -> NDArray[np.bool_] | None:
        """(H, W) bool, the true floor mask, None if there is none."""
        k = self.camera.intrinsics
        return None if self.floor is None else read_mask(self.floor, k.width, k.height)


def has_novel_views(folder: Path | None) -> bool:
    return folder is not None and (folder / LISTING).is_file()


def read_novel_views(folder: Path, alignment: Alignment) -> list[NovelView]:
    """The views in the order of the file, in the aligned frame. Raises InputError naming file and line."""
    path = folder / LISTING
    if not os.path.lexists(path):
        raise InputError(
            f"{path} is missing, so there are no novel views; name a ground truth that has them with --truth DIR."
        )
    intrinsics: Intrinsics | None = None
    views: list[NovelView] = []
    text = read_text(path, "a list of novel views", "write it again", _LONGEST)
    for number, line in enumerate(text.splitlines(), 1):
        found = _PINHOLE.match(line)
        try:
            if found:
                width, height = int(found[1]), int(found[2])
                fx, fy, cx, cy = (float(found[i]) for i in range(3, 7))
                intrinsics = Intrinsics(width, height, fx, fy, cx, cy)
            if not line.strip() or line.startswith("#"):
                continue
            name, *numbers = line.split()
            pose = np.array([float(n) for n in numbers]).reshape(4, 4)
        except ValueError as error:
            raise InputError(
                f"{path}, line {number}, is not the name of an image and the 16 numbers of its pose; correct the line."
            ) from error
        if intrinsics is None:
            raise InputError(f"{path} names views before a line '# PINHOLE width height fx F fy F cx C cy C'; add it.")
        picture = folder / name
        mask = folder / "novel_floor" / f"{picture.stem}.png"
        camera = Camera(intrinsics, aligned_pose(pose, alignment))
        views.append(NovelView(picture.stem, camera, picture, mask if is_regular(mask) else None))
    return views


def aligned_pose(pose: NDArray[np.float64], alignment: Alignment) -> NDArray[np.float64]:
    """A camera-to-world pose (4, 4) of the capture's own frame, converted to the aligned frame."""
    result = np.eye(4)
    result[:3, :3] = alignment.rotation @ pose[:3, :3]
    result[:3, 3] = to_aligned_frame(pose[:3, 3], alignment)
    return result


def novel_score(
    view: NovelView, image: NDArray[np.float32], rendered: NDArray[np.float32], alpha: NDArray[np.float32]
) -> Scores:
    """Metrics of a render: image and rendered (H, W, 3), alpha (H, W), float32.

    novel_psnr is over the whole image, novel_psnr_down over rays that point steeply down, both in dB. novel_alpha_floor
    is the mean alpha on the true floor, NaN without a floor mask or with too few floor pixels."""
    error = ((image - np.clip(rendered, 0, 1)) ** 2).mean(axis=2)
    down = view.camera.rays()[..., 2] < STEEP
    floor = view.floor_mask()
    return {
        "novel_psnr": psnr(float(error.mean())),
        "novel_psnr_down": psnr(float(error[down].mean())) if down.any() else np.nan,
        "novel_alpha_floor": np.nan if floor is None or floor.sum() < LEAST_PIXELS else float(alpha[floor].mean()),
    }


Render = Callable[[Camera], tuple[int, Image, NDArray[np.float32]]]
"""Camera -> submap, rgb (H, W, 3) float32, not clamped, and alpha (H, W) float32 of its view."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A frame that no model was trained on. floor and valid (H, W) bool: the floor, and the pixels that count."""

    index: int
    name: str
    camera: Camera
    image: Image
    floor: Mask
    valid: Mask


def evaluate_views(
    project: Project,
    truth: Path | None = None,
    pictures: Path | None = None,
    listen: Listener = ignore_event,
    *,
    distance: Distance | None = None,
    novel: bool = False,
) -> dict[str, Any]:
    """Metrics of the held-out frames: those of `scores.score` as means over all frames and per submap ("submaps"), and
    for every frame ("per_frame"). With `novel` also those of the novel views. `distance` is an LPIPS.

    Raises InputError if no model is trained, no frame was held out, or there are no novel views.
    """
    scene = project.scene()
    if scene is None:
        raise missing_result_error(project.layout.root, "train")
    folder = truth_of(project, truth)
    frames = held_out_frames(project)
    views = novel_views(project, folder) if novel else []

    def render(camera: Camera) -> tuple[int, Image, NDArray[np.float32]]:
        submap, output = render_scene(scene, camera, frozenset({"rgb", "alpha"}))
        assert output.rgb is not None and output.alpha is not None
        return submap, output.rgb, output.alpha

    rows: list[dict[str, Any]] = []
    total = len(frames) + len(views)
    for done, index in enumerate(frames):
        listen(Progress("evaluate", done, total))
        frame = read_held_out(project, folder, index)
        submap, rgb, alpha = render(frame.camera)
        row = score(frame.image, rgb, alpha, frame.floor, frame.valid, distance)
        rows.append({"frame": index, "submap": submap, **row})
        if pictures is not None:
            _picture(pictures / f"{index:06d}.jpg", frame.image, rgb, alpha)
    novel_rows = score_novel(views, render, listen, (len(frames), total), pictures)
    listen(Progress("evaluate", total, total))
    result: dict[str, Any] = {
        **_means(rows),
        **_means(novel_rows),
        "frames": len(rows),
        "truth": "" if folder is None else str(folder),
        "submaps": {
            s: {
                "frames": sum(r["submap"] == s for r in rows),
                **_means([r for r in rows if r["submap"] == s]),
                **_means([r for r in novel_rows if r["submap"] == s]),
            }
            for s in sorted({r["submap"] for r in rows} | {r["submap"] for r in novel_rows})
        },
        "per_frame": [rounded_metrics(r) for r in rows],
    }
    if novel:
        result["novel_views"], result["per_novel_view"] = len(novel_rows), [rounded_metrics(r) for r in novel_rows]
    return result


def held_out_frames(project: Project) -> list[int]:
    """The indices of the held-out frames, ascending. Raises InputError if there are none."""
    frames = sorted(held_out(len(project.need_capture().frames), capture_config(project).hold_out))
    if not frames:
        raise InputError(f"{project.layout.root} has no held-out frames; import it with --hold-out 8.")
    return frames


def novel_views(project: Project, folder: Path | None) -> list[NovelView]:
    """The novel views of the ground truth in `folder`. Raises InputError if there is no ground truth or it has none."""
    if folder is None:
        raise InputError(f"{project.layout.root} has no ground truth, so no novel views; name one with --truth DIR.")
    return read_novel_views(folder, project.need_capture().alignment)


def read_held_out(project: Project, folder: Path | None, index: int) -> HeldOut:
    """A frame at full size with the masks of the ground truth, or of the project if there is no ground truth."""
    frame = project.need_capture().frames[index]
    k = frame.intrinsics
    size = k.width, k.height
    image = (read_image(frame, k) / np.float32(255)).astype(np.float32)
    floor = true_mask(folder, "floor", frame.name) if folder else None
    transient = true_mask(folder, "transient", frame.name) if folder else None
    usable = usable_pixels(frame, k)
    counted = np.ones((k.height, k.width), bool) if usable is None else usable
    return HeldOut(
        index,
        frame.name,
        frame.camera,
        image,
        read_true_mask(floor, frame, *size) if floor else read_mask(project.mask_path(index), *size),
        counted & ~read_true_mask(transient, frame, *size) if transient else counted,
    )


def score_novel(
    views: Sequence[NovelView],
    render: Render,
    listen: Listener = ignore_event,
    progress: tuple[int, int] = (0, 0),
    pictures: Path | None = None,
) -> list[dict[str, Any]]:
    """Metrics of every novel view. progress: steps finished before, and total steps."""
    before, total = progress
    rows: list[dict[str, Any]] = []
    for done, view in enumerate(views):
        listen(Progress("evaluate", before + done, max(total, 1), "novel views"))
        image = view.image()
        submap, rgb, alpha = render(view.camera)
        rows.append({"view": view.name, "submap": submap, **novel_score(view, image, rgb, alpha)})
        if pictures is not None:
            _picture(pictures / f"novel_{view.name}.jpg", image, rgb, alpha)
    return rows


def _means(rows: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    figures: list[Scores] = [{k: v for k, v in r.items() if k not in ("frame", "view", "submap")} for r in rows]
    return mean_scores(figures)


def _picture(path: Path, image: Image, rgb: Image, alpha: NDArray[np.float32]) -> None:
    make_folder(path.parent)
    row = np.concatenate([image, np.clip(rgb, 0, 1), np.repeat(alpha[..., None], 3, axis=2)], axis=1)
    # OpenCV fails for paths that are not UTF-8, so it only encodes the image in memory.
    encoded = cv2.imencode(".jpg", (row[..., ::-1] * 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
    write_bytes(path, encoded.tobytes())
