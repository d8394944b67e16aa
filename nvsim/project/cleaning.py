"""Removes Gaussians from a project that was imported from splat files, and restores them. The imported models keep all
Gaussians; each has a list of those that are removed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.project.project import Project
from nvsim.project.state.results import model_folders
from nvsim.project.work import missing_result_error
from nvsim.splats.files import load_model, load_removed, store_removed
from nvsim.splats.types import SubmapModel, joined, select_gaussians

if TYPE_CHECKING:
    from nvsim.scene_import.cleaning import Reason
    from nvsim.scene_import.levels import Level


@dataclass(frozen=True, eq=False)
class WholeSplat:
    """All Gaussians of a splat project, also the removed ones. A Gaussian of several submaps is there once.

    models   submap -> its model with all Gaussians
    rows     submap -> (n,) row of each of its Gaussians in `model`
    removed  (N,) bool, the Gaussians that are removed now
    """

    models: dict[int, SubmapModel]
    rows: dict[int, NDArray[np.int64]]
    removed: NDArray[np.bool_]

    @cached_property
    def model(self) -> SubmapModel:
        """All Gaussians as one model."""
        first = next(iter(self.models.values()))
        gaussians = joined(*(model.gaussians for model in self.models.values()))
        places = np.unique(np.concatenate(list(self.rows.values())), return_index=True)[1]
        return SubmapModel(select_gaussians(gaussians, places), None, None, first.floor, first.antialiased)


def read_whole_splat(project: Project) -> WholeSplat:
    """Reads the models of a project from splat files. Raises InputError if the project has images or no models."""
    capture = project.need_capture()
    if capture.has_images:
        raise InputError(f"{project.layout.root} was made from images; only Gaussians of splat files can be removed.")
    folders = model_folders(project.layout)
    if not folders:
        raise missing_result_error(project.layout.root, "import")
    models = {index: load_model(folder, with_removed=True) for index, folder in folders.items()}
    rows = _rows_of(models)
    removed = np.zeros(1 + max((int(own.max(initial=-1)) for own in rows.values()), default=-1), bool)
    for index, folder in folders.items():
        removed[rows[index]] |= load_removed(folder)
    return WholeSplat(models, rows, removed)


def _rows_of(models: dict[int, SubmapModel]) -> dict[int, NDArray[np.int64]]:
    """Submap -> (n,) number of each of its Gaussians. Equal Gaussians have one number; new ones count up."""
    counts = [len(model.gaussians) for model in models.values()]
    if len(models) == 1:
        return {index: np.arange(counts[0]) for index in models}
    parts = (model.gaussians for model in models.values())
    values = [np.column_stack([g.means, g.log_scales, g.quats, g.opacity_logits]) for g in parts]
    table = np.ascontiguousarray(np.concatenate(values))
    keys = table.view(np.dtype((np.void, table.shape[1] * table.itemsize)))[:, 0]
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.empty(len(first), np.int64)
    order[np.argsort(first)] = np.arange(len(first))
    return dict(zip(models, np.split(order[inverse], np.cumsum(counts)[:-1]), strict=True))


def removal_candidates(project: Project, whole: WholeSplat) -> dict[Reason, NDArray[np.bool_]]:
    """Reason -> (N,) bool, the Gaussians of `whole` that should be removed for it. Raises InputError if the import is
    damaged."""
    from nvsim.project.stages.imported import capture_config
    from nvsim.project.stages.imported_splats import CAMERA_HEIGHT
    from nvsim.scene_import.cleaning import find_candidates

    given = capture_config(project).camera_height
    height = CAMERA_HEIGHT if given is None else given
    return find_candidates(whole.model.gaussians, _levels_of(project, whole, height), height)


def _levels_of(project: Project, whole: WholeSplat, height: float) -> tuple[Level, ...]:
    """The storeys, with the places below the viewpoints, which are `height` meters above the floor."""
    from nvsim.project.stages.imported_splats import imported_storeys
    from nvsim.scene_import.levels import Level, ceiling_distances, known_floor

    floors, parts = imported_storeys(project)
    tops, found = ceiling_distances(floors), []
    for submap, storeys in zip(project.need_submaps(), parts, strict=True):
        if len(storeys) == 1:
            model, floor, top = whole.models[submap.index], floors[storeys[0]], tops[storeys[0]]
            grid, known, free = known_floor(model.gaussians, model.floor, floor, top)
            places = submap.positions - [0.0, 0.0, height]
            found.append(Level(floor, model.floor, grid, known, free, places, top))
    return tuple(found)


def remove_gaussians(project: Project, rows: Mapping[int, NDArray[np.int64]], removed: NDArray[np.bool_]) -> None:
    """Stores that exactly the Gaussians `removed` (N,) bool are removed, in the project, which must be writable. This
    outdates the floors and the map, unless they were computed without exactly these Gaussians.

    rows  submap -> (n,) rows of its Gaussians, see WholeSplat

    Raises InputError if all Gaussians would be removed, the models changed since they were read, or the disk
    refuses."""
    if removed.all():
        raise InputError("All Gaussians would be removed; keep some.")
    folders = model_folders(project.layout)
    for index, own in rows.items():
        try:
            store_removed(folders[index], removed[own])
        except (KeyError, ValueError) as error:
            raise InputError(f"{project.layout.root} was imported again; begin to clean again.") from error
