"""Train: one floor-aware model per submap, several at once where that is faster. Resumes from checkpoints; commits a
model folder per submap."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Sequence
from typing import Any

import psutil

from nvsim.errors import InputError
from nvsim.events import Done, Event, Listener, Log, Progress
from nvsim.project import ledger
from nvsim.project.corrections import corrections_key
from nvsim.project.project import Project
from nvsim.project.stages import training_pool
from nvsim.project.stages.floors import floors_key
from nvsim.project.stages.submap_training import train, training_frames, training_views
from nvsim.submaps.types import Submap
from nvsim.training.config import TrainingConfig

__all__ = ["STAGE", "run", "train_key", "training_views"]
STAGE = "train"


def run(
    project: Project,
    config: TrainingConfig,
    listen: Listener,
    only: tuple[int, ...] = (),
    at_once: int = 0,
) -> None:
    """Trains the submaps named in `only`, or all, `at_once` at a time; 0 decides by cores, free memory and their
    number. Raises InputError when the masks are missing or a submap is."""
    submaps = project.need_submaps()
    if not floors_key(project):
        raise InputError(f"{project.layout.root} has no floor masks yet; run `nvsim floors --project` first.")
    unknown = sorted(set(only) - {s.index for s in submaps})
    if unknown:
        raise InputError(f"there is no submap {unknown[0]}; the project has submaps 0 to {len(submaps) - 1}.")
    if at_once < 0:
        raise InputError(f"--at-once {at_once} makes no sense; say how many submaps are trained at a time, or 0.")
    chosen = [s for s in submaps if not only or s.index in only]
    merged = _Merged(listen, [s.index for s in chosen], config.steps)
    left = []
    for submap in chosen:
        if ledger.is_current(project, STAGE, train_key(project, submap, config), submap.index):
            listen(Log(f"Submap {submap.index} is trained already.", STAGE))
            merged.finished(submap.index)
        else:
            left.append(submap)
    if left:
        from nvsim.training.compilation import compile_ahead

        compile_ahead(listen)
    cores = min(config.threads or psutil.cpu_count() or 1, psutil.cpu_count() or 1)
    tasks = training_pool.plan([s.index for s in chosen], cores, at_once or cores)
    together = min(at_once or cores, _fitting(project, left, config)) if left else 1
    waiting = [t for t in tasks if t.submap in {s.index for s in left}]

    def begin(index: int) -> None:
        submap = next(s for s in chosen if s.index == index)
        if not ledger.begin(project, STAGE, train_key(project, submap, config), index):
            project.layout.checkpoint(index).unlink(missing_ok=True)
            shutil.rmtree(project.layout.live(index), ignore_errors=True)

    if all(t.alone for t in waiting):
        for task in waiting:
            begin(task.submap)
            share = dataclasses.replace(config, threads=task.threads)
            _finish(project, task.submap, *train(project, task.submap, share, merged.of(task.submap)), listen)
        return
    for index, message in training_pool.train_together(project.layout.root, config, waiting, together, begin):
        if isinstance(message, training_pool.Trained):
            _finish(project, index, message.seconds, message.figures, listen)
        else:
            merged.of(index)(message)


def train_key(project: Project, submap: Submap, config: TrainingConfig) -> str:
    """What the model of a submap depends on: neither the number of threads nor how often it is saved."""
    default = TrainingConfig()
    same = dataclasses.replace(config, threads=default.threads, checkpoint_seconds=default.checkpoint_seconds)
    corrected = corrections_key(project, training_frames(project, submap.index))
    return ledger.key_of(STAGE, floors_key(project), submap.index, submap.frames, same, *corrected)


def _finish(project: Project, index: int, seconds: float, figures: dict[str, Any], listen: Listener) -> None:
    ledger.finish(project, STAGE, seconds, figures, index)
    project.layout.checkpoint(index).unlink(missing_ok=True)
    listen(Done(STAGE, f"submap {index}: {figures['gaussians']} Gaussians in {seconds:.0f} s", figures))


def _fitting(project: Project, submaps: Sequence[Submap], config: TrainingConfig) -> int:
    """How many of the trainings fit into free memory."""
    frames = project.need_capture().frames
    sizes = [frames[i].intrinsics.within(config.image_size) for i in submaps[0].frames]
    pixels = max(k.width * k.height for k in sizes)
    most = max(len(training_frames(project, s.index)) for s in submaps)
    needed = training_pool.needed_bytes(most, pixels, config)
    return training_pool.fitting(psutil.virtual_memory().available, needed)


class _Merged:
    """Makes the progress of submaps the progress of the stage."""

    def __init__(self, listen: Listener, submaps: Sequence[int], steps: int) -> None:
        self._listen, self._steps = listen, steps
        self._done = dict.fromkeys(submaps, 0)

    def finished(self, submap: int) -> None:
        self._done[submap] = self._steps

    def of(self, submap: int) -> Listener:
        """The listener of one submap."""

        def pass_on(event: Event) -> None:
            if isinstance(event, Progress) and event.stage == STAGE:
                self._done[submap] = event.done
                ended = sum(done >= self._steps for done in self._done.values())
                detail = f"{ended} of {len(self._done)} submaps done"
                event = Progress(STAGE, sum(self._done.values()), self._steps * len(self._done), detail)
            self._listen(event)

        return pass_on
