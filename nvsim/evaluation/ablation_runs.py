"""The rows of the tables that compare trainings, and the training of one submap for a row.

A run is stored in a folder that is named by a hash of its inputs:

P/ablation/KEY/run.json         the request: configuration, submap, seed
P/ablation/KEY/checkpoint.ckpt  during the training
P/ablation/KEY/model/           after the training; the project's own models are never changed

Rows with equal configurations share a key. They are trained once, even for several tables or commands.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim import __version__
from nvsim.errors import InputError
from nvsim.events import Event, Listener, Progress
from nvsim.files import atomic
from nvsim.project import ledger
from nvsim.project.config import held_out
from nvsim.project.corrections import corrections_key
from nvsim.project.project import Project
from nvsim.project.stages.floors import floors_key
from nvsim.project.stages.imported import capture_config
from nvsim.project.stages.submap_training import seen_cloud
from nvsim.project.stages.trained import training_views
from nvsim.splats.files import DESCRIPTION, load_model, save_model
from nvsim.splats.types import SubmapModel
from nvsim.submaps.split import Submap
from nvsim.training.config import PRESETS, TrainingConfig, preset

if TYPE_CHECKING:
    from nvsim.training.views import TrainingView


ABLATION, COMPARISON = "ablation", "presets"
TABLES = (ABLATION, COMPARISON)
_ORDER = ("3dgs", "splatfacto-w", "splatfacto-i", "nvsim")
ROWS = ("base", "masking", "suppression", "floor", "ours")
_VERSION = 1  # to be raised if the same configuration and release would give another model

Views = Callable[[], "list[TrainingView]"]


@dataclass(frozen=True)
class AblationRow:
    """A row of a table.

    name     identifies the row in files and options
    title    text for readers
    config   training configuration of the row
    """

    name: str
    title: str
    config: TrainingConfig


@dataclass(frozen=True)
class Budget:
    """The training budget, equal for all rows. None uses the value of the preset `nvsim`."""

    steps: int | None = None
    image_size: int | None = None
    gaussian_cap: int | None = None

    def apply_to(self, config: TrainingConfig) -> TrainingConfig:
        ours = preset("nvsim")
        return replace(
            config,
            steps=self.steps or ours.steps,
            image_size=self.image_size or ours.image_size,
            gaussian_cap=self.gaussian_cap or ours.gaussian_cap,
        )


def ablation_rows(budget: Budget, names: Sequence[str] = ()) -> tuple[AblationRow, ...]:
    """The paper's second table, cumulative from Splatfacto-W to Splatfacto-i. If `names` is not empty, only these rows.

    The configurations are built from the last row upwards: each row is the next row without that row's change. Points
    on the floor are used as seeds in all rows above the suppression. Raises InputError if a name is not a row.
    """
    base, ours = preset("splatfacto-w"), preset("splatfacto-i")
    floor = replace(ours, loss=replace(ours.loss, alpha=base.loss.alpha))
    suppression = replace(floor, loss=replace(floor.loss, floor=0.0))
    masking = replace(
        suppression,
        seed_height=base.seed_height,
        loss=replace(suppression.loss, suppression=0.0, mask_floor=True),
    )
    configs = (base, masking, suppression, floor, ours)
    titles = (
        "Splatfacto-w (base)",
        "+ masking, pose embedding",
        "+ floor suppression",
        "+ background floor loss",
        "- alpha loss (Splatfacto-i)",
    )
    rows = tuple(AblationRow(n, t, budget.apply_to(c)) for n, t, c in zip(ROWS, titles, configs, strict=True))
    return _choose_rows(rows, names, "rows")


def preset_rows(budget: Budget, names: Sequence[str] = ()) -> tuple[AblationRow, ...]:
    """One row per preset, from plain 3DGS to `nvsim`. If `names` is not empty, only these rows. Raises InputError if a
    name is not a preset."""
    order = sorted(PRESETS, key=lambda n: _ORDER.index(n) if n in _ORDER else len(_ORDER))
    return _choose_rows(tuple(AblationRow(n, n, budget.apply_to(preset(n))) for n in order), names, "presets")


def _choose_rows(rows: tuple[AblationRow, ...], names: Sequence[str], what: str) -> tuple[AblationRow, ...]:
    known = {row.name for row in rows}
    unknown = [n for n in names if n not in known]
    if unknown:
        raise InputError(f"--{what} {unknown[0]} is not known; choose from {', '.join(r.name for r in rows)}.")
    return tuple(row for row in rows if not names or row.name in names)


@dataclass(frozen=True)
class TrainingRun:
    """A training run. The name of `folder` is the hash of all other fields and of the project's floor masks."""

    folder: Path
    submap: Submap
    config: TrainingConfig
    seed: int

    @property
    def model_folder(self) -> Path:
        return self.folder / "model"

    @property
    def checkpoint(self) -> Path:
        return self.folder / "checkpoint.ckpt"

    @property
    def is_done(self) -> bool:
        return (self.model_folder / DESCRIPTION).is_file()


def training_run(project: Project, submap: Submap, config: TrainingConfig, seed: int) -> TrainingRun:
    """The run of a configuration. The configuration's name, threads, and checkpoint interval do not affect the key."""
    plain = dataclasses.replace(config, name="", threads=0, checkpoint_seconds=0.0)
    program = (__version__, _VERSION)
    corrected = corrections_key(project, submap.frames)
    key = ledger.key_of("ablation", program, floors_key(project), submap.index, submap.frames, plain, seed, *corrected)
    return TrainingRun(runs_folder(project) / key, submap, config, seed)


def runs_folder(project: Project) -> Path:
    return project.layout.root / "ablation"


def train_or_load(project: Project, run: TrainingRun, views: Views, listen: Listener) -> SubmapModel:
    """The model of a run. If it does not exist, it is trained, starting from a checkpoint if there is one.

    `views` returns the training images on demand. Raises InputError if the floor surface is missing or the disk
    refuses.
    """
    if run.is_done:
        return load_model(run.model_folder)
    from nvsim.training.compilation import compile_ahead
    from nvsim.training.trainer import train_submap

    compile_ahead(listen)
    surface = project.surface(run.submap.index)
    if surface is None:
        raise InputError(f"{project.layout.surface(run.submap.index)} is missing; run `nvsim floors --project` again.")
    asked = {"submap": run.submap.index, "seed": run.seed, "config": dataclasses.asdict(run.config)}
    atomic.write_text(run.folder / "run.json", json.dumps(asked, indent=1) + "\n")
    seen = views()
    model = train_submap(
        seen,
        seen_cloud(project, surface, seen),
        surface,
        run.config,
        checkpoint=run.checkpoint,
        seed=run.seed,
        submap=run.submap.index,
        listen=listen,
    )
    save_model(model, run.model_folder)
    run.checkpoint.unlink(missing_ok=True)
    return model


def delete_run(run: TrainingRun) -> None:
    """Deletes the run from the disk."""
    shutil.rmtree(run.folder, ignore_errors=True)


def views_of(project: Project, submap: Submap, config: TrainingConfig) -> list[TrainingView]:
    """The training images of a submap, which exclude held-out frames."""
    kept_out = held_out(len(project.need_capture().frames), capture_config(project).hold_out)
    return training_views(project, [i for i in submap.frames if i not in kept_out], config)


class SharedViews:
    """Training images of a submap, shared between runs. They are read on demand, and again for another image size."""

    def __init__(self, project: Project, submap: Submap) -> None:
        self._project, self._submap = project, submap
        self._size = 0
        self._views: list[TrainingView] = []

    def of(self, run: TrainingRun) -> Views:
        def read() -> list[TrainingView]:
            if run.config.image_size != self._size:
                self._views = views_of(self._project, self._submap, run.config)
                self._size = run.config.image_size
            return self._views

        return read


def progress_of_run(listen: Listener, stage: str, before: int, total: int, name: str) -> Listener:
    """A listener that converts the progress of one run to that of all runs, of whose steps `before` are finished."""

    def pass_on(event: Event) -> None:
        if isinstance(event, Progress):
            event = Progress(stage, before + event.done, total, name)
        listen(event)

    return pass_on
