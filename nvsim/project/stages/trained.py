"""Trains one floor-aware model per submap, several in parallel if that is faster. Continues from checkpoints, and
commits one model folder per submap."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from contextlib import closing

import psutil

from nvsim.cluster.local import LocalPool
from nvsim.cluster.piece import (
    Executor,
    Message,
    SentFile,
    StorageNotShared,
    WorkCall,
    WorkItem,
    WorkResult,
    threads_each,
)
from nvsim.errors import InputError
from nvsim.events import Done, Event, Listener, Log, Progress, ignore_event
from nvsim.project import ledger
from nvsim.project.corrections import corrections_key
from nvsim.project.earlier_results import report_replaced_result
from nvsim.project.project import Project
from nvsim.project.stages import training_pool
from nvsim.project.stages.floors import floors_key
from nvsim.project.stages.submap_training import (
    TrainedSubmap,
    train,
    train_in_child,
    training_frames,
    training_views,
)
from nvsim.project.stages.submaps import submaps_of_capture
from nvsim.project.state.results import remove_folder
from nvsim.project.work import StageName, missing_result_error
from nvsim.submaps.split import Submap
from nvsim.training.config import TrainingConfig
from nvsim.training.devices.choice import gpu_name

__all__ = ["STAGE", "run", "train_key", "training_views"]
STAGE: StageName = "train"


def run(
    project: Project,
    config: TrainingConfig,
    listen: Listener = ignore_event,
    only: tuple[int, ...] = (),
    at_once: int = 0,
    executor: Executor | None = None,
) -> None:
    """Trains the submaps in `only`, or all if it is empty.

    at_once   number of submaps in parallel; 0 selects it by cores, free memory and number of submaps
    executor  runs the trainings; None for processes of this machine

    Raises InputError if the masks are missing or belong to another cut, a submap does not exist, or `at_once` is
    negative.
    """
    submaps = submaps_of_capture(project)
    if not floors_key(project):
        raise missing_result_error(project.layout.root, "floors")
    if project.uses_previous_submaps("floors"):
        raise InputError(
            f"The floors of {project.layout.root} belong to another cut into submaps; run `nvsim floors --project` "
            "first."
        )
    unknown = sorted(set(only) - {s.index for s in submaps})
    if unknown:
        raise InputError(f"There is no submap {unknown[0]}; the project has submaps 0 to {len(submaps) - 1}.")
    if at_once < 0:
        raise InputError(f"--at-once {at_once} is negative; give the number of submaps in parallel, or 0.")
    on_card = executor is None and gpu_name(config.device) is not None
    chosen = [s for s in submaps if not only or s.index in only]
    asked, config = config.steps, adapt_to_capture(project, config)
    if config.steps != asked:
        why = "because estimated depth replaces a LiDAR scan"
        listen(Log(f"Submaps train {config.steps} steps, not {asked}, {why}; --scanless.steps 1 keeps {asked}.", STAGE))
    merged = _StageProgress(listen, [s.index for s in chosen], config.steps)
    left = []
    keys = {s.index: train_key(project, s, config) for s in chosen}
    for submap in chosen:
        if ledger.trained_key(project, submap.index) == keys[submap.index]:
            listen(Log(f"Submap {submap.index} is trained already.", STAGE))
            merged.finished(submap.index)
        else:
            left.append(submap)
    unfinished = project.stage_results().unfinished
    works = {s.index: unfinished.get((STAGE, s.index)) for s in submaps}
    current = {s.index for s in chosen} - {s.index for s in left}
    others = {i for i, work in works.items() if work is not None and work.key == keys.get(i, work.key)} - current
    ledger.clear_unfinished(project, others)
    executor = executor or LocalPool()
    if left:
        report_replaced_result(project, STAGE, listen, tuple(s.index for s in left))
        if not executor.remote:
            from nvsim.training.compilation import compile_ahead

            compile_ahead(listen)

    def begin(index: int) -> None:
        if not ledger.begin_part(project, STAGE, keys[index], index):
            project.layout.checkpoint(index).unlink(missing_ok=True)
            remove_folder(project.layout.live_model(index))

    def finish(index: int, found: TrainedSubmap) -> None:
        _finish(project, index, config, found, listen)

    run = _SubmapTraining(project, config, merged, begin, finish)
    if executor.remote and left:
        run.train_remotely(executor, [s.index for s in chosen], left, at_once, listen)
    elif left:
        cores = min(config.threads or psutil.cpu_count() or 1, psutil.cpu_count() or 1)
        most = at_once or (1 if on_card else cores)  # a GPU trains one submap at a time unless the user asks for more
        tasks = training_pool.plan([s.index for s in chosen], cores, most)
        together = min(most, _fitting(project, left, config))
        run.train_here(executor, [t for t in tasks if t.submap in {s.index for s in left}], together)


class _SubmapTraining:
    """Trains submaps with an executor. `begin` is called when a submap starts, `finish` with its result."""

    def __init__(
        self,
        project: Project,
        config: TrainingConfig,
        merged: _StageProgress,
        begin: Callable[[int], None],
        finish: Callable[[int, TrainedSubmap], None],
    ) -> None:
        self._project, self._config, self._merged = project, config, merged
        self._begin, self._finish = begin, finish

    def train_here(self, executor: Executor, tasks: Sequence[training_pool.TrainingTask], at_once: int) -> None:
        """Trains in processes of this machine, or in this process if no two submaps train in parallel."""
        if all(t.alone for t in tasks):
            for task in tasks:
                self._begin(task.submap)
                share = dataclasses.replace(self._config, threads=task.threads)
                self._finish(task.submap, train(self._project, task.submap, share, self._merged.of(task.submap)))
            return
        pieces = [WorkItem(STAGE, t.submap, f"submap {t.submap}", t.threads, 0, t.alone) for t in tasks]

        def order(piece: WorkItem) -> WorkCall:
            self._begin(piece.part)
            share = dataclasses.replace(self._config, threads=piece.cores)
            return WorkCall(train_in_child, (self._project.layout.root, piece.part, share))

        with closing(executor.run(pieces, order, at_once)) as messages:
            for piece, message in messages:
                if isinstance(message, WorkResult):
                    self._finish(piece.part, message.value)
                else:
                    self._merged.forward_message(piece.part, message)

    def train_remotely(
        self,
        executor: Executor,
        chosen: Sequence[int],
        left: Sequence[Submap],
        at_once: int,
        listen: Listener,
    ) -> None:
        """Trains on other machines. The number of threads depends on all `chosen` submaps, not only on those `left`."""
        from nvsim.project.stages.training_remote import ModelFiles, RemoteTraining

        threads = self._config.threads or threads_each(executor.machines, min(at_once or len(chosen), len(chosen)))
        needed = _memory_of_largest(self._project, left, self._config)
        pieces = [WorkItem(STAGE, s.index, f"submap {s.index}", threads, needed) for s in left]
        remote_training = RemoteTraining(self._project, self._config, executor.storage, listen)

        def order(piece: WorkItem) -> WorkCall:
            self._begin(piece.part)
            return remote_training.order(piece)

        try:
            with closing(executor.run(pieces, order, at_once)) as messages:
                for piece, message in messages:
                    event: Message | None = message
                    if isinstance(message, WorkResult):
                        found: ModelFiles = message.value
                        remote_training.check(piece, found)
                        self._finish(piece.part, found.trained)
                        continue
                    if isinstance(message, StorageNotShared):
                        remote_training.send_all_inputs(message)
                        continue
                    if isinstance(message, SentFile):
                        event = remote_training.receive(piece, message)
                    if event is not None:
                        self._merged.forward_message(piece.part, event)
        finally:
            remote_training.close()


def adapt_to_capture(project: Project, config: TrainingConfig) -> TrainingConfig:
    """`config` adapted to the capture: longer training if estimated depth replaces a LiDAR scan."""
    scanless = project.stage_results().depth is not None and not project.need_capture().is_measured
    return config.without_scan() if scanless else config


def train_key(project: Project, submap: Submap, config: TrainingConfig) -> str:
    """The key of a submap's model. It does not depend on the device, the number of threads, or the checkpoint
    interval."""
    corrected = corrections_key(project, training_frames(project, submap.index))
    depth = project.stage_results().depth
    seen = [depth.key] if depth else []  # without depth, the key has the form of versions without a depth stage
    return ledger.key_of(
        STAGE, floors_key(project), submap.index, submap.frames, _result_settings(config), *corrected, *seen
    )


def _result_settings(config: TrainingConfig) -> dict[str, object]:
    default = TrainingConfig()
    same = dataclasses.replace(config, threads=default.threads, checkpoint_seconds=default.checkpoint_seconds)
    values = dataclasses.asdict(same)
    del values["device"], values["scanless"]  # the number of steps and the rates already include scanless
    return {TrainingConfig.__name__: values}


def _finish(project: Project, index: int, config: TrainingConfig, found: TrainedSubmap, listen: Listener) -> None:
    seconds, figures = found.seconds, found.figures
    batch = ledger.key_of(floors_key(project), _result_settings(config))
    used = ledger.add_model(project, index, seconds, figures, batch)
    listen(Done(STAGE, f"submap {index}: {figures['gaussians']} Gaussians in {seconds:.0f} s", figures))
    if not used:
        former = len(project.submaps("train"))
        words = f"The {former} models of the previous cut stay in use until all {len(project.submaps())} are trained."
        listen(Log(words, STAGE))


def _fitting(project: Project, submaps: Sequence[Submap], config: TrainingConfig) -> int:
    """The number of trainings that fit into the free memory."""
    return training_pool.count_that_fit(psutil.virtual_memory().available, _memory_of_largest(project, submaps, config))


def _memory_of_largest(project: Project, submaps: Sequence[Submap], config: TrainingConfig) -> int:
    """Memory in bytes of the largest training."""
    frames = project.need_capture().frames
    sizes = [frames[i].intrinsics.limited_to(config.image_size) for i in submaps[0].frames]
    pixels = max(k.width * k.height for k in sizes)
    most = max(len(training_frames(project, s.index)) for s in submaps)
    return training_pool.needed_bytes(most, pixels, config)


class _StageProgress:
    """Converts the progress of single submaps to the progress of the stage."""

    def __init__(self, listen: Listener, submaps: Sequence[int], steps: int) -> None:
        self._listen, self._steps = listen, steps
        self._done = dict.fromkeys(submaps, 0)

    def finished(self, submap: int) -> None:
        self._done[submap] = self._steps

    def forward_message(self, submap: int, message: Message) -> None:
        """Passes on a message about a submap."""
        if isinstance(message, Event):
            self.of(submap)(message)

    def of(self, submap: int) -> Listener:
        """The listener of one submap."""

        def pass_on(event: Event) -> None:
            if isinstance(event, Progress) and event.stage == STAGE:
                self._done[submap] = event.done
                ended = sum(done >= self._steps for done in self._done.values())
                detail = f"{ended} of {len(self._done)} submaps done" if len(self._done) > 1 else ""
                event = Progress(STAGE, sum(self._done.values()), self._steps * len(self._done), detail)
            self._listen(event)

        return pass_on
