"""Compare the depth of images with ground truth."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.frame_numbers import number_in
from nvsim.files.opening import read_bytes
from nvsim.project.project import Project
from nvsim.project.work import missing_result_error

WITHIN = (2, 5, 10)
"""Percent of the true depth."""
Float32 = NDArray[np.float32]


def evaluate_depth(pairs: Iterable[tuple[Float32, Float32]]) -> dict[str, Any]:
    """Metrics of pairs of depth maps (H, W) float32, estimated and true, meters, 0 if unknown.

    within_2, within_5, within_10  share of the pixels with both depths whose error is at most so many percent of the
                                   true depth; None if there is no such pixel
    covered                        share of the pixels with a true depth that have an estimated one
    frames                         number of pairs
    """
    near, both, known, frames = dict.fromkeys(WITHIN, 0), 0, 0, 0
    for found, true in pairs:
        there = true > 0
        seen = there & (found > 0)
        error = np.abs(found[seen] - true[seen]) / true[seen]
        frames, known, both = frames + 1, known + int(there.sum()), both + int(seen.sum())
        for per_cent in WITHIN:
            near[per_cent] += int(np.count_nonzero(error <= per_cent / 100))
    shares = {f"within_{p}": round(count / both, 4) if both else None for p, count in near.items()}
    return {**shares, "covered": round(both / known, 4) if known else None, "frames": frames}


def evaluate_project_depth(project: Project, truth: Path | None) -> dict[str, Any]:
    """`evaluate_depth` of the frames for which the folder `truth`, or the built-in building, has a depth map. A true
    map is sampled at the pixel centers of the estimated one. Raises InputError if depth or ground truth is missing."""
    from nvsim.depth.files import depth_path, read_depth

    folder = truth or project.layout.ground_truth / "depth"
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder of true depth maps; name one with --truth DIR.")
    results = project.stage_results()
    if results.depth is None:
        skipped = getattr(results.part("depth"), "summary", {}).get("skipped")
        if skipped:
            again = "run `nvsim depth --depth always --project` first"
            raise InputError(f"{project.layout.root} has no depth, as {skipped}; {again}.")
        raise missing_result_error(project.layout.root, "depth")
    own = project.layout.depth
    frames = project.need_capture().frames
    found = {
        number_in(own, f.name, i): path
        for i, f in enumerate(frames)
        if (path := _true_depth(folder, i, f.name)) is not None
    }
    if not found:
        raise InputError(f"{folder} has no depth map for any frame (looked for 000000.png and names of images).")
    missing = next((i for i in found if not depth_path(own, i).is_file()), None)
    if missing is not None:
        raise InputError(f"{depth_path(own, missing)} is missing; run `nvsim depth --project` again.")

    def pairs() -> Iterable[tuple[Float32, Float32]]:
        for i, path in found.items():
            estimated = read_depth(own, i)
            yield estimated, _at_size(frames[i].lens.upright(_read_truth(path)), *estimated.shape)

    return evaluate_depth(pairs())


def _true_depth(folder: Path, index: int, frame_name: str) -> Path | None:
    """The true depth map of a frame. The image name is tried before the index, because the ground truth's 000004.png
    may belong to the image 000004.jpg at any index."""
    for name in (f"{PurePosixPath(frame_name).stem}.png", f"{index:06d}.png"):
        if (folder / name).is_file():
            return folder / name
    return None


def _read_truth(path: Path) -> Float32:
    import cv2

    from nvsim.files.images import decode_pixels

    again = "a depth map has one channel of 16 bits, in millimeters"
    stored = decode_pixels(read_bytes(path), path, cv2.IMREAD_UNCHANGED, what="a depth map", then=again)
    if stored.ndim != 2 or stored.dtype != np.uint16:
        raise InputError(f"{path} is not a depth map: it must have one channel of 16 bits; write it again.")
    return stored.astype(np.float32) / np.float32(1000)


def _at_size(depth: Float32, height: int, width: int) -> Float32:
    rows = ((np.arange(height) + 0.5) * depth.shape[0] / height).astype(int)
    columns = ((np.arange(width) + 0.5) * depth.shape[1] / width).astype(int)
    sized: Float32 = depth[rows[:, None], columns]
    return sized
