"""Training of one submap, from views to a model: order of the views, schedule, refinement, events, and resuming.

Preview images show image and model side by side, below them the parts of the model. Files exist for the newest step and
for some earlier ones.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np
import torch
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.events import Listener, Log, Metric, Preview, Progress, Warning, ignore_event
from nvsim.files.atomic import write_bytes
from nvsim.files.reading import reading
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.workspace import LOCK
from nvsim.splats.files import save_model
from nvsim.splats.types import SubmapModel
from nvsim.training import checkpoint as files
from nvsim.training.checkpoint import RateLimiter
from nvsim.training.config import TrainingConfig
from nvsim.training.floor_paint import initial_floor_paint
from nvsim.training.initialize import initial_gaussians
from nvsim.training.loss.floor_aware import LossValues
from nvsim.training.model_fit import ModelFit
from nvsim.training.robust import robust_mask
from nvsim.training.strategies.choice import strategy_of
from nvsim.training.views import TrainingView

STAGE = "train"
REPORT_SECONDS = 0.4
PREVIEW_SECONDS = 5.0
PREVIEW_SHARE = 0.02
"""Greatest share of the time for preview images."""
CHECKPOINT_SECONDS = 3.0
CHECKPOINT_SHARE = 0.02
"""Greatest share of the time for checkpoints: a small training loses less if the machine stops."""
_SMOOTHING = 0.95
MOST_STEPS = 20
KEPT_RUNS = 2
QUALITY = 92  # of JPEG


def train_submap(
    views: Sequence[TrainingView],
    cloud: Cloud | None,
    floor: FloorSurface,
    config: TrainingConfig,
    *,
    checkpoint: Path | None = None,
    seed: int = 0,
    submap: int = 0,
    listen: Listener = ignore_event,
    preview: Path | None = None,
    live: Path | None = None,
    watched: TrainingView | None = None,
) -> SubmapModel:
    """Trains the floor-aware model of one submap (paper, section III-C).

    views       the training views; frames held out for evaluation must not be among them
    cloud       the initial places of Gaussians; without it, matched image features or random places
    floor       the local floor, which carries the texture; Gaussians below it are removed
    checkpoint  a file that is written at intervals, and resumed if it belongs to equal inputs
    submap      the number of the submap in events
    preview     an image file that is rewritten at intervals, with one image of some steps beside it, see `preview`
    watched     the view of the preview, preferably a held-out frame; by default one of the training views
    live        a folder to which the current model is saved with every preview image

    The result depends only on the inputs, `seed`, and the number of threads, also after an interruption, provided that
    the kernels are compiled (`compilation.compile_ahead`). A run resumed with another number of threads differs by the
    rounding of sums. Raises InputError if there are no views, or if a file cannot be written.
    """
    if not views:
        raise InputError("A submap without images cannot be trained; give it frames or merge it with its neighbor.")
    threads, torch_threads = numba.get_num_threads(), torch.get_num_threads()
    cores = int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    chosen = min(config.threads or cores, cores)
    numba.set_num_threads(chosen)
    # Only a color network benefits from several threads; otherwise a second pool would compete with numba's.
    torch.set_num_threads(chosen if config.appearance.kind == "network" else 1)
    try:
        run = _TrainingRun(views, cloud, floor, config, seed, submap, listen)
        if checkpoint is not None:
            key = files.fingerprint(views, cloud, floor, config, seed)
            try:
                run.attach(checkpoint, key)
            except InputError as error:
                listen(Warning(f"{error} Training starts again.", STAGE))
                run = _TrainingRun(
                    views, cloud, floor, config, seed, submap, listen
                )  # the first can be partly restored
                run.save_to(checkpoint, key)
        return run.finish(preview, live, watched)
    finally:
        numba.set_num_threads(threads)
        torch.set_num_threads(torch_threads)


class _TrainingRun:
    def __init__(
        self,
        views: Sequence[TrainingView],
        cloud: Cloud | None,
        floor: FloorSurface,
        config: TrainingConfig,
        seed: int,
        submap: int,
        listen: Listener,
    ) -> None:
        self._config, self._submap, self._listen = config, submap, listen
        self._views = views
        self._sizes = [list(views)]
        for _ in range(config.coarse_levels if config.coarse_share > 0 else 0):
            self._sizes.append([v.at_half_size() for v in self._sizes[-1]])
        self._rng = np.random.default_rng(seed)
        gaussians = initial_gaussians(views, cloud, floor, config, self._rng)
        networks, texture = initial_floor_paint(self._sizes[min(1, len(self._sizes) - 1)], floor, config, seed)
        self.fit = ModelFit(gaussians, networks, texture, floor, config, len(views))
        self._strategy = strategy_of(config, floor, self._rng)
        k = views[0].camera.intrinsics
        self._robust = robust_mask(config, len(views), k.width, k.height)
        self._parts: dict[str, files.Stateful] = {"fit": self.fit, "robust": self._robust}
        self._step = 0
        self._order: list[int] = []
        self._figures = {"loss": 0.0, "psnr": 0.0}
        self._seconds = 0.0
        self._path: Path | None = None
        self._key = ""
        self._name = f"{int(time.time()):x}"  # of its preview images; nothing else depends on it

    def attach(self, path: Path, key: str) -> None:
        """Resumes from the file at `path` if it fits, and saves later checkpoints to it. Raises InputError if it is
        damaged; this run must then be discarded."""
        self.save_to(path, key)
        if not os.path.lexists(path):
            return
        found = files.load(path, key)
        if found is None:
            self._listen(Warning(f"{path} belongs to other inputs; training starts again.", STAGE))
            return
        progress = found.progress
        with reading(path, "a checkpoint of this training", "delete it to train from the start"):
            of_gaussians = {"fit/sums"}
            of_gaussians |= {f"fit/{n}.{p}" for n in self.fit.held.names for p in ("values", "first", "second")}
            files.check_shapes(files.arrays_of_parts(self._parts), found.arrays, of_gaussians)
            files.restore_parts(self._parts, found.arrays)
            self._rng.bit_generator.state = progress["random"]
            self._order = [range(len(self._views))[index] for index in progress["order"]]
            self._figures = {name: float(progress["figures"][name]) for name in self._figures}
            self._name = progress["run"] if is_run(progress.get("run")) else self._name
            self._seconds, self._step = float(progress["seconds"]), min(found.step, self._config.steps)
        threads = numba.get_num_threads()
        changed = (
            "" if progress.get("threads") == threads else f", threads: {threads} instead of {progress.get('threads')}"
        )
        self._listen(Log(f"Submap {self._submap} continues from step {self._step}{changed}.", STAGE))

    def save_to(self, path: Path, key: str) -> None:
        """Saves checkpoints to `path` from now on."""
        self._path, self._key = path, key

    def finish(
        self, preview: Path | None, live: Path | None = None, watched: TrainingView | None = None
    ) -> SubmapModel:
        """Makes all remaining steps and returns the model."""
        c = self._config
        started = reported = time.monotonic()
        counted = self._step
        shown = RateLimiter(-math.inf, PREVIEW_SECONDS, PREVIEW_SHARE)  # the first one at once
        saved = RateLimiter(started, CHECKPOINT_SECONDS, CHECKPOINT_SHARE, most=c.checkpoint_seconds)
        before = self._seconds
        while self._step < c.steps:
            values = self._advance()
            now = time.monotonic()
            self._seconds = before + now - started
            last = self._step == c.steps
            if last or now - reported >= REPORT_SECONDS:
                self._report(values, (self._step - counted) / max(now - reported, 1e-9))
                reported, counted = now, self._step
            if preview is not None and (last or shown.is_due(now)):
                self._show(preview, None if last else live, watched)
                shown.record_run(now, time.monotonic())
            now = time.monotonic()
            if self._path is not None and (last or saved.is_due(now)):
                self._save(self._path)
                saved.record_run(now, time.monotonic())
        return self.fit.model(self._info())

    def _advance(self) -> LossValues:
        c, step = self._config, self._step + 1
        share = self._step / c.steps
        if not self._order:
            self._order = self._rng.permutation(len(self._views)).tolist()
        index = self._order.pop()
        view = self._sizes[count_halvings(c, share)][index]
        canvas = self.fit.canvas(view.camera.intrinsics.width, view.camera.intrinsics.height)
        canvas.inlier[:] = True if view.usable is None else view.usable
        if c.random_background and not c.background:
            canvas.background[:] = self._rng.random((3, 1, 1), np.float32)
        judge = self._robust.begin(step, index, view.image, canvas.inlier)
        values = self.fit.differentiate(view, canvas.inlier, sh_degree_at(c, share), index, judge)
        if view.usable is not None:
            canvas.loss.error[:, ~view.usable] = 0
        self._robust.end(index, canvas.loss.error)
        self._strategy.before_update(self.fit.held, step)
        self.fit.move(step)
        self._strategy.after_update(self.fit.held, step)
        keep = _SMOOTHING if step > 1 else 0.0
        for name, value in (("loss", values.total), ("psnr", values.psnr)):
            self._figures[name] = keep * self._figures[name] + (1 - keep) * value
        self._step = step
        return values

    def _report(self, values: LossValues, rate: float) -> None:
        c, step = self._config, self._step
        count = len(self.fit.held)
        self._listen(Progress(STAGE, step, c.steps, f"{self._figures['psnr']:.1f} dB, {count} Gaussians"))
        figures = {**self._figures, "gaussians": float(count), "steps_per_second": rate}
        for name, value in figures.items():
            self._listen(Metric(STAGE, name, float(value), step, self._submap))

    def _show(self, path: Path, live: Path | None, watched: TrainingView | None) -> None:
        if live is not None:
            save_model(self.fit.model(self._info()), live)
        view = watched or self._views[len(self._views) // 2]
        picture = preview(self.fit, view)
        written = PreviewFiles(path, self._name).write(picture, self._step)
        if watched is not None:
            self._listen(Metric(STAGE, "psnr_held_out", psnr_of(picture), self._step, self._submap))
        kind = "held-out" if watched is not None else "training"
        words = f"submap {self._submap}, step {self._step}: {kind} photo {view.name}, model; alpha, background"
        self._listen(Preview(STAGE, str(written), words, self._step, self._submap))

    def _save(self, path: Path) -> None:
        progress: dict[str, Any] = {
            "random": self._rng.bit_generator.state,
            "order": self._order,
            "figures": self._figures,
            "seconds": self._seconds,
            "run": self._name,
            "threads": numba.get_num_threads(),
        }
        files.save(path, files.Checkpoint(self._step, files.arrays_of_parts(self._parts), progress), self._key)

    def _info(self) -> dict[str, object]:
        return {
            "preset": self._config.name,
            "steps": self._step,
            "training_seconds": round(self._seconds, 1),
            "training_psnr": round(self._figures["psnr"], 2),
        }


def count_halvings(config: TrainingConfig, share: float) -> int:
    """How many times the images are halved when `share` of the steps are done."""
    if share >= config.coarse_share:
        return 0
    return int(np.ceil(config.coarse_levels * (1 - share / config.coarse_share)))


def sh_degree_at(config: TrainingConfig, share: float) -> int:
    """The degree of the spherical harmonics in use when `share` of the steps are done."""
    return config.sh_degree if config.sh_interval == 0 else min(int(share / config.sh_interval), config.sh_degree)


def preview(fit: ModelFit, view: TrainingView) -> NDArray[np.uint8]:
    """(2 H, 2 W, 3) uint8 RGB. Above are image and model; below are the alpha of the Gaussians and the background with
    the floor texture alone. Alpha should be black on the floor."""
    model, alpha = fit.composite(view.camera)
    with LOCK:
        background = fit.paint(view.camera, np.ones_like(alpha)).transpose(1, 2, 0).copy()
    below = np.concatenate([np.repeat(alpha[..., None], 3, axis=2), background], axis=1)
    above = np.concatenate([view.image, _bytes(model)], axis=1)
    return np.concatenate([above, _bytes(below)])


def psnr_of(picture: NDArray[np.uint8]) -> float:
    """Decibels between image and model of a `preview` (2 H, 2 W, 3), rounded to 8 bits."""
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    error = picture[:height, :width].astype(np.float32) - picture[:height, width:]
    return float(10 * np.log10(255**2 / max(float(np.mean(error**2)), 1e-3)))


class PreviewFiles:
    """The newest image at `path`, and beside it files NAME_RUN_STEP.jpg. There are at most MOST_STEPS steps of this
    run, spread over it, and those of the KEPT_RUNS - 1 previous runs.

    run  name of the training, hexadecimal, increasing with time; a run resumed from a checkpoint keeps its name
    """

    def __init__(self, path: Path, run: str) -> None:
        self._path, self._run = path, run

    def write(self, picture: NDArray[np.uint8], step: int) -> Path:
        """Writes the image (H, W, 3) RGB of a step; returns the path that keeps it. Raises InputError if it cannot be
        written."""
        # OpenCV fails on a path that is not UTF-8, so it only encodes.
        data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
        write_bytes(self._path, data)
        path = self._path.with_name(f"{self._path.stem}_{self._run}_{step:07d}.jpg")
        write_bytes(path, data)
        self._remove_old_files(step)
        return path

    def _remove_old_files(self, step: int) -> None:
        found = _runs(self._path)
        for run in sorted(found.keys() - {self._run})[: -(KEPT_RUNS - 1)]:
            _remove(found[run].values())
        mine = found.get(self._run, {})
        _remove(mine.pop(later) for later in [s for s in mine if s > step])  # steps after a checkpoint were not kept
        steps = sorted(mine)
        while len(steps) > MOST_STEPS:
            # Remove the step whose neighbors are nearest to each other; the first and the last stay.
            least = min(range(1, len(steps) - 1), key=lambda i: (steps[i + 1] - steps[i - 1], i))
            _remove([mine[steps.pop(least)]])


def is_run(name: object) -> bool:
    """Whether `name` is valid as the name of a run."""
    return isinstance(name, str) and re.fullmatch("[0-9a-f]{1,16}", name) is not None


def _runs(path: Path) -> dict[str, dict[int, Path]]:
    """Run -> step -> file, for all files beside `path`."""
    pattern = re.compile(re.escape(path.stem) + r"_([0-9a-f]{1,16})_(\d{1,12})\.jpg")
    found: dict[str, dict[int, Path]] = {}
    for file in path.parent.iterdir():
        match = pattern.fullmatch(file.name)
        if match is not None:
            found.setdefault(match[1], {})[int(match[2])] = file
    return found


def _remove(files: Iterable[Path]) -> None:
    for file in files:
        with contextlib.suppress(OSError):  # tried again later
            file.unlink(missing_ok=True)


def _bytes(colors: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.asarray(255 * np.clip(colors, 0, 1), np.uint8)
