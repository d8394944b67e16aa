"""The depth stage: dense depth of every frame from its neighbors, and the fused point cloud of all frames.

If a frame has a depth image, the depth image replaces the estimate. Each frame is first estimated alone and then
confirmed by its neighbors. Every result is written immediately, so an interrupted run continues where it stopped.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.depth_images import inverse_depth
from nvsim.capture.types import Capture
from nvsim.depth.agreement import AgreedDepth, compare_depth_maps
from nvsim.depth.config import DepthConfig
from nvsim.depth.files import (
    confidence_path,
    depth_path,
    draft_path,
    read_depth,
    read_draft,
    write_depth,
    write_draft,
)
from nvsim.depth.fusion import FusedCells, FusedCloud, Map, concatenate_parts, fuse, joined, return_freed_memory
from nvsim.depth.labeling import label_planes
from nvsim.depth.planes import Plane, find_planes, is_behind_floor
from nvsim.depth.refinement import refine, smooth_depth
from nvsim.depth.smoothing import best_inverse_depth, smooth_cost
from nvsim.depth.sweep import sweep
from nvsim.depth.view import Views, Warp, neighbors
from nvsim.depth.visibility import Carver, DepthCheck
from nvsim.events import Listener, Progress, ignore_event
from nvsim.files.atomic import make_folder
from nvsim.geometry.camera import Camera

STAGE = "depth"
_KEPT_VIEWS = 96
_KEPT_MAPS = 96
_REACH = 2.0  # pixels, standard deviation of the filter that smooths depth
_NOISE = 0.01  # standard deviation of a measured depth, as a share of the depth


Phase = Literal["single", "confirmed", "labelled", "shown", "finished"]
"""The phases of the stage. Each is completed for all frames before the next begins:

- single: depth of a frame alone
- confirmed: depth that its neighbors confirm
- labeled: gaps filled with planes of the building
- shown: depth that the neighbors confirm after filling
- finished: depth that the whole capture does not contradict

All phases except the last leave drafts."""
PHASES: tuple[Phase, ...] = get_args(Phase)
_ESTIMATED: tuple[Phase, ...] = ("confirmed", "labelled")
"""The phases that are skipped for frames with a depth image."""
Float32 = NDArray[np.float32]
Draft = Callable[[int], tuple[Float32, Float32]]
Elsewhere = Callable[[Phase, list[int], list[Plane], Callable[[int], None]], None]
"""Function that processes frames of a phase elsewhere, such as on other computers. Its arguments are the phase, the
frames, the planes known so far, and a callback for each finished frame. It may skip frames."""


def estimate_depth(
    capture: Capture,
    folder: Path,
    config: DepthConfig | None = None,
    listen: Listener = ignore_event,
    elsewhere: Elsewhere | None = None,
) -> FusedCloud:
    """Write depth and confidence of every frame to `folder` (see `nvsim.depth.files`) and return the fused cloud.

    The fused cloud has no points if the images give no depth. Frames that `elsewhere` skips are processed here. Frames
    whose files exist are not processed again. Raises InputError if an image cannot be read or the folder cannot be
    written; files that are already written are kept.
    """
    config = config or DepthConfig()
    frames = FramesInPhases(capture, folder, config)
    views, count = frames.views, len(capture.frames)
    cameras = [views.camera(i) for i in range(count)]
    steps = _FrameWorkers(capture, config, listen, len(PHASES) * count)
    if not all(depth_exists(folder, i) for i in range(count)):
        for phase in PHASES[:-1]:
            make_folder(folder / phase)
        for phase in PHASES:
            frames.clear_caches()
            if phase == "labelled" and frames.missing(phase):
                parts = _fuse_maps(cameras, frames.maps["confirmed"], config, config.min_observations)
                frames.planes = find_planes(part.seen for part in parts)
            if phase == "finished":
                frames.rest = _check_of_all_maps(cameras, frames.maps["shown"], config)
            steps.begin(count - len(frames.missing(phase)))
            if elsewhere is not None and phase != "finished" and frames.missing(phase):
                elsewhere(phase, frames.missing(phase), frames.planes, steps.report_done)
            steps.run_for_frames(frames.missing(phase), partial(frames.do, phase, folder))
    frames.rest = None  # its points need as much memory as the cloud that follows
    frames.clear_caches()
    for phase in PHASES[:-1]:
        shutil.rmtree(folder / phase, ignore_errors=True)
    listen(Progress(STAGE, steps.total, steps.total))

    def read_written(index: int) -> Float32:
        depth = read_depth(folder, index)
        with np.errstate(divide="ignore"):
            return np.where(depth > 0, 1 / depth, 0).astype(np.float32)

    def read_with_colors(index: int) -> Map:
        inverse = read_written(index)
        return inverse, np.ones_like(inverse), views.image(index)

    carver = Carver(cameras, read_written, config.threads)
    return joined(
        part.select(carver.exists(part.seen.points))
        for part in fuse(cameras, read_with_colors, config.voxel, config.min_observations, config.threads)
    )


class FramesInPhases:
    """The frames of a capture, with their depth and drafts in `folder`.

    The phase "labelled" uses `planes`, and "finished" uses `rest`. Frames with a depth image skip "confirmed" and
    "labelled", because measured depth needs neither."""

    def __init__(self, capture: Capture, folder: Path, config: DepthConfig, planes: Sequence[Plane] = ()) -> None:
        self._folder, self._config, self.planes = folder, config, list(planes)
        self.rest: DepthCheck | None = None
        self.views = Views(capture.frames, config.longest_side, config.threshold, _KEPT_VIEWS)
        self._measured = capture.depth_of_frames
        self._drafts = lru_cache(maxsize=_KEPT_MAPS)(lambda phase, index: read_draft(folder / phase, index))
        self.maps: dict[Phase, Draft] = {phase: partial(self._map, phase) for phase in PHASES[:-1]}

    def missing(self, phase: Phase) -> list[int]:
        """Indices of the frames for which the phase is not done."""
        count = len(self.views.poses)
        if phase == "finished":
            return [i for i in range(count) if not depth_exists(self._folder, i)]
        todo = [i for i in range(count) if phase not in _ESTIMATED or i not in self._measured]
        return [i for i in todo if not draft_path(self._folder / phase, i).is_file()]

    def clear_caches(self) -> None:
        """Free the views and drafts of the previous phase. The next phase begins with other frames."""
        self.views.at.cache_clear()
        self._drafts.cache_clear()
        return_freed_memory()

    def _map(self, phase: Phase, index: int) -> tuple[Float32, Float32]:
        skipped = phase in _ESTIMATED and index in self._measured
        return self._drafts("single" if skipped else phase, index)

    def do(self, phase: Phase, out: Path, index: int) -> None:
        """Process one frame of a phase and write the result to the folder `out`. Raises InputError if an image cannot
        be read or the result cannot be written."""
        {
            "single": self._single,
            "confirmed": self._confirm,
            "labelled": self._label,
            "shown": self._show,
            "finished": self._finish,
        }[phase](out, index)

    def _single(self, out: Path, index: int) -> None:
        if index in self._measured:
            inverse = self._remove_masked(index, inverse_depth(self._measured[index], self.views.camera(index)))
            with np.errstate(divide="ignore"):
                weight = np.where(inverse > 0, 1 / (_NOISE * inverse) ** 2, 0).astype(np.float32)
        else:
            inverse, weight = estimate_single_frame(self.views, index, self._config)
        write_draft(out / "single", index, inverse, weight)

    def _remove_masked(self, index: int, inverse: Float32) -> Float32:
        """`inverse` (H, W) with 0 where the frame's mask ignores pixels."""
        usable = self.views.usable(index)
        return inverse if usable is None else np.where(usable, inverse, 0).astype(np.float32)

    def _confirm(self, out: Path, index: int) -> None:
        found = self._confirm_frame("single", index)
        write_draft(out / "confirmed", index, found.inverse, found.weight)

    def _label(self, out: Path, index: int) -> None:
        views, config, planes = self.views, self._config, self.planes
        known = _certain(views.camera(index), *read_draft(self._folder / "confirmed", index), planes, config)
        chosen = neighbors(views.poses, index, config.labeling_sources, config.baseline)
        camera = views.camera(index)
        warps = [Warp.between(camera, views.camera(j)) for j in chosen]
        sources = [views.at(j) for j in chosen]
        found, which = label_planes(views.at(index), sources, warps, known, planes, config.labels)
        found = self._remove_masked(index, found)
        write_draft(out / "labelled", index, found, np.where(which >= 0, 4.0, 1.0).astype(np.float32))

    def _show(self, out: Path, index: int) -> None:
        found = self._confirm_frame("labelled", index)
        if index in self._measured:  # other maps add confirmations, but do not change the measured depth
            own, _ = self.maps["labelled"](index)
            kept = found.through <= found.views + 1
            found = replace(found, inverse=np.where(kept, own, 0).astype(np.float32))
        write_draft(out / "shown", index, found.inverse, found.views.astype(np.float32))

    def _finish(self, out: Path, index: int) -> None:
        assert self.rest is not None
        inverse, views = self.maps["shown"](index)
        kept = np.where(self.rest.contradicted_pixels(index), 0, inverse).astype(np.float32)
        write_depth(out, index, kept, np.rint(views).astype(np.uint8))

    def _confirm_frame(self, phase: Phase, index: int) -> AgreedDepth:
        config = self._config
        near = neighbors(self.views.poses, index, config.compared_maps, config.baseline, 0.1)
        least = 0 if index in self._measured else config.views
        return _confirm_depth(self.views, index, near, self.maps[phase], config, least)


class _FrameWorkers:
    """Runs the work of frames in parallel and reports the progress of the whole stage."""

    def __init__(self, capture: Capture, config: DepthConfig, listen: Listener, total: int) -> None:
        self._capture, self._config, self._listen, self.total = capture, config, listen, total
        self._done = 0

    def begin(self, done: int) -> None:
        """Start a phase in which `done` frames were processed by an earlier run."""
        self._done += done

    def report_done(self, index: int) -> None:
        """Report that a frame is done."""
        self._done += 1
        self._listen(Progress(STAGE, self._done, self.total, self._capture.frames[index].name))

    def run_for_frames(self, todo: list[int], work: Callable[[int], None]) -> None:
        """Run `work` for every frame of `todo`."""
        with ThreadPoolExecutor(self._config.threads) as pool:
            jobs = {pool.submit(work, i): i for i in todo}
            try:
                for job in as_completed(jobs):
                    job.result()
                    self.report_done(jobs[job])
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def _confirm_depth(
    views: Views,
    index: int,
    near: list[int],
    maps: Draft,
    config: DepthConfig,
    least: int,
) -> AgreedDepth:
    """The depth of frame `index` confirmed by the frames `near`: the mean, and 0 where fewer than `least` agree."""
    found, weight = maps(index)
    camera = views.camera(index)
    others = [(*maps(j), Warp.between(camera, views.camera(j))) for j in near]
    result = compare_depth_maps(found, weight, others, config.tolerance, config.tolerance_offset)
    known = (result.views >= least) & ((2 * result.through <= result.views) | (least == 0))
    inverse, weight = np.where(known, result.inverse, 0), np.where(known, result.weight, 0)
    return replace(result, inverse=inverse.astype(np.float32), weight=weight.astype(np.float32))


def _certain(
    camera: Camera,
    inverse: NDArray[np.float32],
    weight: NDArray[np.float32],
    planes: list[Plane],
    config: DepthConfig,
) -> NDArray[np.float32]:
    """`inverse` (H, W), 1 / meters, where it is accurate and not a reflection in the floor; 0 elsewhere."""
    sure = inverse * np.sqrt(weight) >= 1 / config.max_uncertainty
    rows, columns = np.nonzero(sure)
    rays = camera.rays()[rows, columns]
    depth = 1 / inverse[rows, columns, None] / (rays @ camera.rotation[:, 2])[:, None]
    behind = is_behind_floor(planes, camera.position, camera.position + depth * rays)
    sure[rows[behind], columns[behind]] = False
    return np.where(sure, inverse, 0).astype(np.float32)


def _check_of_all_maps(cameras: list[Camera], maps: Draft, config: DepthConfig) -> DepthCheck:
    """The evidence of all depth maps of a capture, with equal weight for every pixel."""

    def inverse(index: int) -> Float32:
        return maps(index)[0]

    def map_with_equal_weights(index: int) -> tuple[Float32, Float32]:
        return inverse(index), np.ones_like(inverse(index))

    carver, kept = Carver(cameras, inverse, config.threads), [np.empty((0, 3), np.float32)]
    for part in _fuse_maps(cameras, map_with_equal_weights, config, config.checked_observations):
        points = part.seen.points
        kept.append(points[carver.exists(points)])
    return DepthCheck(concatenate_parts(kept), cameras, inverse, config)


def _fuse_maps(cameras: list[Camera], maps: Draft, config: DepthConfig, seen: int) -> Iterator[FusedCells]:
    """The cells of all maps with at least `seen` observations, without colors."""

    def read(index: int) -> Map:
        inverse, weight = maps(index)
        return inverse, weight, np.zeros((*inverse.shape, 3), np.uint8)

    return fuse(cameras, read, config.voxel, seen, config.threads)


def estimate_single_frame(views: Views, index: int, config: DepthConfig) -> tuple[Float32, Float32]:
    """Depth of one frame alone, as two (H, W) float32 arrays.

    The first is inverse depth, 1 / meters, 0 where unknown. The second is its inverse variance, meters squared: the
    amount of information in the images."""
    view = views.at(index)
    chosen = neighbors(views.poses, index, config.sources, config.baseline)
    if not chosen:
        return np.zeros_like(view.gray), np.zeros_like(view.gray)
    warps = [Warp.between(view.camera, views.camera(j)) for j in chosen]
    turned, shifts = np.stack([w.turned for w in warps]), np.stack([w.shift for w in warps])
    sources = [views.at(j).gray for j in chosen]
    inverse = np.linspace(1 / config.farthest, 1 / config.nearest, config.planes)
    step = float(inverse[1] - inverse[0])
    cost = sweep(view.census, sources, turned, shifts, inverse, config.threshold)
    total = smooth_cost(cost, view.gray, config.small_change_cost, config.large_change_cost, config.edge_step)
    found, margin = best_inverse_depth(total, inverse.astype(np.float32))
    found[(margin < config.margin) | (view.gray < 0)] = 0
    found = smooth_depth(found, _REACH, 2 * step)
    knowledge = np.zeros_like(found)
    few = config.refining_sources
    for _ in range(config.steps):
        found, knowledge = refine(
            view.gray, sources[:few], turned[:few], shifts[:few], found, config.window, step, config.noise
        )
        found = smooth_depth(found, _REACH, 0.5 * step)
    with np.errstate(divide="ignore"):
        return found, (1 / (1 / knowledge + np.float32(config.min_deviation**2))).astype(np.float32)


def depth_exists(folder: Path, index: int) -> bool:
    """Whether the depth and the confidence of a frame are on disk."""
    return depth_path(folder, index).is_file() and confidence_path(folder, index).is_file()
