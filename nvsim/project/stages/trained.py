"""Train: one floor-aware model per submap. Resumes from its checkpoint; commits a model folder per submap."""

from __future__ import annotations

import shutil
import time
from typing import TYPE_CHECKING

from nvsim.errors import InputError
from nvsim.events import Done, Event, Listener, Log, Progress
from nvsim.project import ledger
from nvsim.project.config import held_out
from nvsim.project.project import Project
from nvsim.project.stages.floors import floors_key
from nvsim.project.stages.imported import capture_config
from nvsim.submaps.types import Submap
from nvsim.training.config import TrainingConfig

if TYPE_CHECKING:
    from nvsim.training.views import TrainingView

STAGE = "train"


def run(
    project: Project,
    config: TrainingConfig,
    listen: Listener,
    only: tuple[int, ...] = (),
) -> None:
    """Trains the submaps named in `only`, or all. Raises InputError when the masks are missing or a submap is."""
    submaps = project.need_submaps()
    if not floors_key(project):
        raise InputError(f"{project.layout.root} has no floor masks yet; run `nvsim floors --project` first.")
    unknown = sorted(set(only) - {s.index for s in submaps})
    if unknown:
        raise InputError(f"there is no submap {unknown[0]}; the project has submaps 0 to {len(submaps) - 1}.")
    chosen = [s for s in submaps if not only or s.index in only]
    for i, submap in enumerate(chosen):
        key = train_key(project, submap, config)
        if ledger.is_current(project, STAGE, key, submap.index):
            listen(Log(f"Submap {submap.index} is trained already.", STAGE))
            continue
        _train_one(project, submap, key, config, _scaled(listen, i, len(chosen)))


def train_key(project: Project, submap: Submap, config: TrainingConfig) -> str:
    """What the model of a submap depends on."""
    return ledger.key_of(STAGE, floors_key(project), submap.index, submap.frames, config)


def _scaled(listen: Listener, index: int, count: int) -> Listener:
    """Makes the progress of one submap the progress of the stage."""

    def pass_on(event: Event) -> None:
        if isinstance(event, Progress) and event.stage == STAGE:
            detail = f"submap {index + 1} of {count}"
            event = Progress(STAGE, index * event.total + event.done, count * event.total, detail)
        listen(event)

    return pass_on


def _train_one(
    project: Project,
    submap: Submap,
    key: str,
    config: TrainingConfig,
    listen: Listener,
) -> None:
    from nvsim.splats.files import save_model
    from nvsim.training.trainer import train_submap

    layout, capture = project.layout, project.need_capture()
    checkpoint, folder = layout.checkpoint(submap.index), layout.model(submap.index)
    if not ledger.begin(project, STAGE, key, submap.index):
        checkpoint.unlink(missing_ok=True)
    shutil.rmtree(folder, ignore_errors=True)
    started = time.monotonic()
    surface = project.surface(submap.index)
    if surface is None:
        raise InputError(f"{layout.surface(submap.index)} is missing; run `nvsim floors --project` again.")
    kept_out = held_out(len(capture.frames), capture_config(project).hold_out)
    views = training_views(project, [i for i in submap.frames if i not in kept_out], config)
    model = train_submap(
        views,
        capture.cloud,
        surface,
        config,
        checkpoint=checkpoint,
        submap=submap.index,
        listen=listen,
        preview=layout.preview(submap.index),
    )
    save_model(model, folder)
    seconds = time.monotonic() - started
    summary = {"gaussians": len(model.gaussians), "views": len(views), **model.info}
    ledger.finish(project, STAGE, seconds, summary, submap.index)
    checkpoint.unlink(missing_ok=True)
    listen(Done(STAGE, f"submap {submap.index}: {len(model.gaussians)} Gaussians in {seconds:.0f} s", summary))


def training_views(project: Project, frames: list[int], config: TrainingConfig) -> list[TrainingView]:
    """The images and floor masks of `frames` at the training size. Raises InputError for one that cannot be read."""
    from concurrent.futures import ThreadPoolExecutor

    from nvsim.capture.images import read_image
    from nvsim.perception.segment import read_mask
    from nvsim.training.views import TrainingView

    capture = project.need_capture()

    def view(index: int) -> TrainingView:
        frame = capture.frames[index]
        size = frame.intrinsics.within(config.image_size)
        camera = frame.camera.scaled(size.width, size.height)
        mask = read_mask(project.layout.mask(index), size.width, size.height)
        return TrainingView(frame.name, camera, read_image(frame, size), mask)

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(view, frames))
