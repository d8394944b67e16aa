"""The training of one submap of a project, from its files to its model folder: all of it but the ledger, so that any
process can do it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.project import results
from nvsim.project.config import held_out
from nvsim.project.corrections import mask_in_use
from nvsim.project.layout import model_name
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_config
from nvsim.training.config import TrainingConfig

if TYPE_CHECKING:
    from nvsim.training.views import TrainingView


def train(
    project: Project, index: int, config: TrainingConfig, listen: Listener, ready: Callable[[], None] = lambda: None
) -> tuple[float, dict[str, Any]]:
    """Trains submap `index`, from its checkpoint where there is one, and saves its model where the ledger says that it
    is made, beside the one in use; returns the seconds it took and figures. Calls `ready` when everything is read and
    the first kernel about to run. Raises InputError for images or a floor that cannot be read."""
    from nvsim.splats.files import save_model
    from nvsim.training.trainer import train_submap

    layout = project.layout
    place = results.made_at(project.connection, "train", index)[model_name(index)]
    started = time.monotonic()
    surface = project.surface(index)
    if surface is None:
        raise InputError(f"{layout.surface(index)} is missing; run `nvsim floors --project` again.")
    views = training_views(project, training_frames(project, index), config)
    watched = watched_frame(project, index)
    ready()
    model = train_submap(
        views,
        project.scan_on(surface),
        surface,
        config,
        checkpoint=layout.checkpoint(index),
        submap=index,
        listen=listen,
        preview=layout.preview(index),
        live=layout.live(index),
        watched=None if watched is None else training_views(project, [watched], config)[0],
    )
    save_model(model, layout.root / place)
    return time.monotonic() - started, {"gaussians": len(model.gaussians), "views": len(views), **model.info}


def training_frames(project: Project, index: int) -> list[int]:
    """The frames of a submap that are not held out."""
    kept_out = held_out(len(project.need_capture().frames), capture_config(project).hold_out)
    submap = next(s for s in project.need_submaps() if s.index == index)
    return [i for i in submap.frames if i not in kept_out]


def watched_frame(project: Project, index: int) -> int | None:
    """The held-out frame that shows how far the training of a submap is: the middle one of its core, else of all its
    frames; None where it has none."""
    kept_out = held_out(len(project.need_capture().frames), capture_config(project).hold_out)
    submap = next(s for s in project.need_submaps() if s.index == index)
    for frames in (submap.core, submap.frames):
        found = [i for i in frames if i in kept_out]
        if found:
            return found[len(found) // 2]
    return None


def training_views(project: Project, frames: list[int], config: TrainingConfig) -> list[TrainingView]:
    """The images and floor masks of `frames` at the training size. Raises InputError for one that cannot be read."""
    from concurrent.futures import ThreadPoolExecutor

    from nvsim.capture.images import read_image
    from nvsim.perception.segment import read_mask_and_doubt
    from nvsim.training.views import TrainingView

    capture, layout = project.need_capture(), project.layout

    def view(index: int) -> TrainingView:
        frame = capture.frames[index]
        size = frame.intrinsics.within(config.image_size)
        camera = frame.camera.scaled(size.width, size.height)
        mask, doubtful = read_mask_and_doubt(mask_in_use(layout, frame, index), size.width, size.height)
        return TrainingView(frame.name, camera, read_image(frame, size), mask, doubtful)

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(view, frames))
