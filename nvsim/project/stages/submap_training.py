"""Trains one submap of a project, from its files to its model folder. It does not write to the database, so that any
process can run it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nvsim.cluster.piece import Caller
from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.project.config import held_out
from nvsim.project.layout import model_name
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config
from nvsim.training.config import TrainingConfig

if TYPE_CHECKING:
    from nvsim.capture.types import Cloud
    from nvsim.geometry.floor_surface import FloorSurface
    from nvsim.training.views import TrainingView


@dataclass(frozen=True)
class TrainedSubmap:
    """The result of training a submap: its duration in seconds, and figures for the record of the stage."""

    seconds: float
    figures: dict[str, Any]


@dataclass(frozen=True, eq=False)
class TrainingInputs:
    """The inputs to train a submap, and a held-out view that shows the progress, if there is one."""

    views: list[TrainingView]
    cloud: Cloud | None
    surface: FloorSurface
    watched: TrainingView | None


def train(
    project: Project, index: int, config: TrainingConfig, listen: Listener, ready: Callable[[], None] = lambda: None
) -> TrainedSubmap:
    """Trains submap `index` from its checkpoint if there is one, and saves its model at the place recorded for the new
    result. Calls `ready` after reading all inputs, just before the first kernel. Raises InputError if images or the
    floor cannot be read."""
    layout = project.layout
    place = project.stage_results().made_at("train", index)[model_name(index)]
    started = time.monotonic()
    inputs = inputs_of(project, index, config)
    ready()
    paths = layout.checkpoint(index), layout.preview(index), layout.live_model(index)
    figures = fit(inputs, index, config, layout.root / place, listen, *paths)
    return TrainedSubmap(time.monotonic() - started, figures)


def train_in_child(caller: Caller, root: Path, index: int, config: TrainingConfig) -> TrainedSubmap:
    """Like `train`, in a child process of the process that has the project open for writing."""
    with Project.open(root) as project:
        return train(project, index, config, caller.send_event, caller.wait_for_kernels)


def inputs_of(project: Project, index: int, config: TrainingConfig) -> TrainingInputs:
    """The inputs to train submap `index`. Raises InputError if images or the floor cannot be read."""
    surface = project.surface(index)
    if surface is None:
        raise InputError(f"{project.layout.surface(index)} is missing; run `nvsim floors --project` again.")
    views = training_views(project, training_frames(project, index), config)
    watched = watched_frame(project, index)
    held = None if watched is None else training_views(project, [watched], config)[0]
    return TrainingInputs(views, seen_cloud(project, surface, views), surface, held)


def seen_cloud(project: Project, surface: FloorSurface, views: Sequence[TrainingView]) -> Cloud | None:
    """The part of the project's cloud near the cameras of `views`."""
    from nvsim.training.initialize import FARTHEST

    return project.scan_on(surface, np.array([view.camera.position for view in views]).reshape(-1, 3), FARTHEST)


def fit(
    inputs: TrainingInputs,
    index: int,
    config: TrainingConfig,
    folder: Path,
    listen: Listener,
    checkpoint: Path,
    preview: Path,
    live: Path | None,
) -> dict[str, Any]:
    """Trains a model from `inputs`, see `train_submap`, and saves it in `folder`. Returns figures."""
    from nvsim.splats.files import save_model
    from nvsim.training.trainer import train_submap

    model = train_submap(
        inputs.views,
        inputs.cloud,
        inputs.surface,
        config,
        checkpoint=checkpoint,
        submap=index,
        listen=listen,
        preview=preview,
        live=live,
        watched=inputs.watched,
    )
    save_model(model, folder)
    return {"gaussians": len(model.gaussians), "views": len(inputs.views), **model.info}


def training_frames(project: Project, index: int) -> list[int]:
    """Indices of the frames of a submap that are not held out."""
    kept_out = held_out(len(project.need_capture().frames), capture_config(project).hold_out)
    submap = next(s for s in project.need_submaps() if s.index == index)
    return [i for i in submap.frames if i not in kept_out]


def watched_frame(project: Project, index: int) -> int | None:
    """The held-out frame that shows the progress of the training. It is in the middle of the submap's core, or else of
    all its frames. None if the submap has no held-out frame."""
    kept_out = held_out(len(project.need_capture().frames), capture_config(project).hold_out)
    submap = next(s for s in project.need_submaps() if s.index == index)
    for frames in (submap.core, submap.frames):
        found = [i for i in frames if i in kept_out]
        if found:
            return found[len(found) // 2]
    return None


def training_views(project: Project, frames: list[int], config: TrainingConfig) -> list[TrainingView]:
    """Images and floor masks of `frames` at the training size. Raises InputError if an image or mask cannot be read."""
    from concurrent.futures import ThreadPoolExecutor

    from nvsim.capture.images import read_image
    from nvsim.capture.masks import usable_pixels
    from nvsim.perception.segment import read_mask_and_doubt
    from nvsim.training.views import TrainingView

    capture, layout = project.need_capture(), project.layout

    def view(index: int) -> TrainingView:
        frame = capture.frames[index]
        size = frame.intrinsics.limited_to(config.image_size)
        camera = frame.camera.scaled(size.width, size.height)
        mask, doubtful = read_mask_and_doubt(layout.mask_in_use(frame.name, index), size.width, size.height)
        usable = usable_pixels(frame, size)
        if usable is not None:  # a user may have painted floor on ignored pixels
            mask &= usable
        return TrainingView(frame.name, camera, read_image(frame, size), mask, doubtful, usable)

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(view, frames))
