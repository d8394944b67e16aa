"""Finds the occupancy map to compare a project with, and refuses maps that cannot evaluate it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.errors import InputError
from nvsim.occupancy.ros import read_provenance
from nvsim.project.makers import makers_of

if TYPE_CHECKING:
    from nvsim.project.project import Project


def built_map(project: Project) -> Path | None:
    """The map in the project that was built from its capture. None if there is none, or if it belongs to another
    capture or was rendered from trained models. Raises InputError if it cannot be read."""
    path, capture = project.layout.occupancy, project.capture()
    if capture is None or not path.is_file():
        return None
    said = read_provenance(path)
    if said is None or said.source == "trained" or not set(said.makers) & set(makers_of(capture, None)):
        return None
    return path


def true_map(project: Project) -> Path | None:
    """The map file for comparison with the project, or the folder with the maps of its storeys: that of the built-in
    building, else the built map. None if there is none. Raises InputError like `built_map`."""
    return project.layout.true_map or built_map(project)


def refuse_own_depth(map: Path, project: Project) -> None:
    """Raises InputError if `map` was built from rendered depth of the project's own models, or of models of its
    trajectory. Such a map has the errors of these models and would confirm them."""
    said = read_provenance(map)
    if said is None or said.source != "trained":
        return
    if set(said.makers) & set(makers_of(project.need_capture(), project)):
        raise InputError(
            f"{map} was built from the rendered depth of this project's own models, so it cannot evaluate them; "
            "build a map with `nvsim occupancy build --source lidar`, depth or images."
        )
