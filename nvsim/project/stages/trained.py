"""Train: one floor-aware model per submap, several at once where that is faster. Resumes from checkpoints; commits a
model folder per submap."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import psutil

from nvsim.errors import InputError
from nvsim.events import Done, Event, Listener, Log, Progress
from nvsim.project import ensemble, ledger, results
from nvsim.project.corrections import corrections_key
from nvsim.project.project import Project
from nvsim.project.replaced import listen_to_what_is_replaced
from nvsim.project.scan import depth_in_use
from nvsim.project.stages import training_pool
from nvsim.project.stages.floors import floors_key
from nvsim.project.stages.submap_training import train, training_frames, training_views
from nvsim.project.stages.submaps import submaps_of_capture
from nvsim.project.work import StageName, lacks
from nvsim.submaps.types import Submap
from nvsim.training.config import TrainingConfig

__all__ = ["STAGE", "run", "train_key", "training_views"]
STAGE: StageName = "train"


def run(
    project: Project,
    config: TrainingConfig,
    listen: Listener,
    only: tuple[int, ...] = (),
    at_once: int = 0,
) -> None:
    """Trains the submaps named in `only`, or all, `at_once` at a time; 0 decides by cores, free memory and their
    number. Raises InputError when the masks are missing or a submap is."""
    submaps = submaps_of_capture(project)
    if not floors_key(project):
        raise lacks(project.layout.root, "floors")
    if results.is_former(project.connection, "floors"):
        raise InputError(
            f"The floors of {project.layout.root} were found with another cut into submaps; run "
            "`nvsim floors --project` first."
        )
    unknown = sorted(set(only) - {s.index for s in submaps})
    if unknown:
        raise InputError(f"there is no submap {unknown[0]}; the project has submaps 0 to {len(submaps) - 1}.")
    if at_once < 0:
        raise InputError(f"--at-once {at_once} makes no sense; say how many submaps are trained at a time, or 0.")
    chosen = [s for s in submaps if not only or s.index in only]
    merged = _Merged(listen, [s.index for s in chosen], config.steps)
    left = []
    keys = {s.index: train_key(project, s, config) for s in chosen}
    for submap in chosen:
        if ensemble.trained_key(project, submap.index) == keys[submap.index]:
            listen(Log(f"Submap {submap.index} is trained already.", STAGE))
            merged.finished(submap.index)
        else:
            left.append(submap)
    unfinished = {s.index: results.work(project.connection, STAGE, s.index) for s in submaps}
    current = {s.index for s in chosen} - {s.index for s in left}
    others = {i for i, work in unfinished.items() if work is not None and work[0] == keys.get(i, work[0])} - current
    ensemble.clear_unfinished(project, others)
    if left:
        listen_to_what_is_replaced(project, STAGE, listen, tuple(s.index for s in left))
        from nvsim.training.compilation import compile_ahead

        compile_ahead(listen)
    cores = min(config.threads or psutil.cpu_count() or 1, psutil.cpu_count() or 1)
    tasks = training_pool.plan([s.index for s in chosen], cores, at_once or cores)
    together = min(at_once or cores, _fitting(project, left, config)) if left else 1
    waiting = [t for t in tasks if t.submap in {s.index for s in left}]

    def begin(index: int) -> None:
        if not ledger.begin(project, STAGE, keys[index], index):
            project.layout.checkpoint(index).unlink(missing_ok=True)
            results.remove_folder(project.layout.live(index))

    if all(t.alone for t in waiting):
        for task in waiting:
            begin(task.submap)
            share = dataclasses.replace(config, threads=task.threads)
            _finish(project, task.submap, config, *train(project, task.submap, share, merged.of(task.submap)), listen)
        return
    for index, message in training_pool.train_together(project.layout.root, config, waiting, together, begin):
        if isinstance(message, training_pool.Trained):
            _finish(project, index, config, message.seconds, message.figures, listen)
        else:
            merged.of(index)(message)


def train_key(project: Project, submap: Submap, config: TrainingConfig) -> str:
    """What the model of a submap depends on: neither the number of threads nor how often it is saved."""
    corrected = corrections_key(project, training_frames(project, submap.index))
    depth = depth_in_use(project)
    seen = [depth.key] if depth else []  # without depth the key is that of before there was a depth stage
    return ledger.key_of(STAGE, floors_key(project), submap.index, submap.frames, _same(config), *corrected, *seen)


def _same(config: TrainingConfig) -> TrainingConfig:
    default = TrainingConfig()
    return dataclasses.replace(config, threads=default.threads, checkpoint_seconds=default.checkpoint_seconds)


def _finish(
    project: Project, index: int, config: TrainingConfig, seconds: float, figures: dict[str, Any], listen: Listener
) -> None:
    batch = ledger.key_of(floors_key(project), _same(config))
    used = ensemble.add_model(project, index, seconds, figures, batch)
    listen(Done(STAGE, f"submap {index}: {figures['gaussians']} Gaussians in {seconds:.0f} s", figures))
    if not used:
        former = len(project.submaps("train"))
        words = f"The models of the former {former} submaps stay in use until all {len(project.submaps())} are trained."
        listen(Log(words, STAGE))


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
