"""Held-out frames against what the models render there: PSNR and SSIM at full size, with and without the floor.

A frame is held out when its number is hold_out // 2 and every hold_out-th after it (hold_out 8 by default: frames 4,
12, 20, ...); held-out frames take no part in training nor in the floor's support. Figures are means over frames of
figures per frame. Where the truth has transient masks, pixels of people are left out: nobody can predict them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.atomic import make_folder, replacing
from nvsim.capture.images import read_image
from nvsim.errors import InputError
from nvsim.evaluation.truth import true_mask
from nvsim.events import Listener, Progress, silent
from nvsim.perception.segment import read_mask
from nvsim.project.config import held_out
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config
from nvsim.render.scene import render_scene

_LEAST_PIXELS = 500  # fewer floor pixels than this say nothing about a floor


def evaluate_views(
    project: Project, truth: Path | None = None, pictures: Path | None = None, listen: Listener = silent
) -> dict[str, Any]:
    """Figures of the held-out frames: psnr, psnr_floor, psnr_nonfloor, ssim, psnr_floor_constant (what a floor of its
    one best colour would get), alpha_floor, alpha_nonfloor, frames, submaps (per submap). Raises InputError when
    nothing is trained or nothing was held out."""
    capture, scene = project.need_capture(), project.scene()
    if scene is None:
        raise InputError(f"{project.layout.root} has no trained submap yet; run `nvsim train --project` first.")
    frames = sorted(held_out(len(capture.frames), capture_config(project).hold_out))
    if not frames:
        raise InputError(f"{project.layout.root} holds no frame out of training; import it with --hold-out 8.")
    folder = truth
    if folder is None and project.layout.ground_truth.is_dir():
        folder = project.layout.ground_truth
    rows: list[dict[str, float]] = []
    for done, index in enumerate(frames):
        listen(Progress("evaluate", done, len(frames)))
        frame = capture.frames[index]
        image = (read_image(frame, frame.intrinsics) / np.float32(255)).astype(np.float32)
        submap, output = render_scene(scene, frame.camera, frozenset({"rgb", "alpha"}))
        assert output.rgb is not None and output.alpha is not None
        floor, valid = _regions(project, folder, index, frame.name, image.shape[:2])
        row = _figures(image, np.clip(output.rgb, 0, 1), output.alpha, floor, valid)
        rows.append({"frame": index, "submap": submap, **row})
        if pictures is not None:
            _picture(pictures / f"{index:06d}.jpg", image, output.rgb, output.alpha)
    listen(Progress("evaluate", len(frames), len(frames)))
    names = [k for k in rows[0] if k not in ("frame", "submap")]
    result: dict[str, Any] = {k: _mean([r[k] for r in rows]) for k in names}
    result["frames"] = len(rows)
    result["truth"] = "" if folder is None else str(folder)
    result["submaps"] = {
        s: {k: _mean([r[k] for r in rows if r["submap"] == s]) for k in names}
        for s in sorted({r["submap"] for r in rows})
    }
    result["per_frame"] = rows
    return result


def _regions(
    project: Project, folder: Path | None, index: int, name: str, shape: tuple[int, int]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The floor of a frame, and the pixels that count."""
    height, width = shape
    floor_path = true_mask(folder, "floor", name) if folder else None
    floor = read_mask(floor_path or project.layout.mask(index), width, height)
    transient_path = true_mask(folder, "transient", name) if folder else None
    valid = ~read_mask(transient_path, width, height) if transient_path else np.ones(shape, bool)
    return floor, valid


def _figures(
    image: NDArray[np.float32],
    rendered: NDArray[np.float32],
    alpha: NDArray[np.float32],
    floor: NDArray[np.bool_],
    valid: NDArray[np.bool_],
) -> dict[str, float]:
    error = ((image - rendered) ** 2).mean(axis=2)
    on, off = floor & valid, ~floor & valid
    enough = int(on.sum()) >= _LEAST_PIXELS
    constant = ((image[on] - image[on].mean(axis=0)) ** 2).mean() if enough else np.nan
    return {
        "psnr": _psnr(error[valid].mean()),
        "psnr_nonfloor": _psnr(error[off].mean()) if off.any() else np.nan,
        "psnr_floor": _psnr(error[on].mean()) if enough else np.nan,
        "psnr_floor_constant": _psnr(constant),
        "ssim": _ssim(image, rendered, valid),
        "alpha_floor": float(alpha[on].mean()) if enough else np.nan,
        "alpha_nonfloor": float(alpha[off].mean()) if off.any() else np.nan,
    }


def _psnr(mean_square: float) -> float:
    return float(-10 * np.log10(max(float(mean_square), 1e-10))) if np.isfinite(mean_square) else float("nan")


def _ssim(a: NDArray[np.float32], b: NDArray[np.float32], valid: NDArray[np.bool_]) -> float:
    """Wang et al. 2004: 11x11 Gaussian window of sigma 1.5, mean over the pixels that count and the channels."""

    def blur(x: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.GaussianBlur(x, (11, 11), 1.5), np.float32)

    c1, c2 = 0.01**2, 0.03**2
    ma, mb = blur(a), blur(b)
    va, vb, vab = blur(a * a) - ma * ma, blur(b * b) - mb * mb, blur(a * b) - ma * mb
    index = (2 * ma * mb + c1) * (2 * vab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2))
    return float(index[valid].mean())


def _mean(values: list[float]) -> float | None:
    finite = [v for v in values if np.isfinite(v)]
    return round(float(np.mean(finite)), 4) if finite else None


def _picture(path: Path, image: NDArray[np.float32], rgb: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
    make_folder(path.parent)
    row = np.concatenate([image, np.clip(rgb, 0, 1), np.repeat(alpha[..., None], 3, axis=2)], axis=1)
    with replacing(path) as temporary:
        cv2.imwrite(str(temporary), (row[..., ::-1] * 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 92])
