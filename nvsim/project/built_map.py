"""The occupancy map that was built of a project, and maps that may not judge it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.errors import InputError
from nvsim.occupancy.ros import read_provenance
from nvsim.project.makers import makers_of

if TYPE_CHECKING:
    from nvsim.project.project import Project


def built_map(project: Project) -> Path | None:
    """The file of the map that was built of the project's capture and lies in the project; None where there is none, or
    one of another capture. Raises InputError when it cannot be read."""
    path, capture = project.layout.occupancy, project.capture()
    if capture is None or not path.is_file():
        return None
    said = read_provenance(path)
    if said is None or said.source == "trained" or not set(said.makers) & set(makers_of(capture, None)):
        return None
    return path


def true_map(project: Project) -> Path | None:
    """The file of the map that a project is compared with, or the folder with those of the storeys: the truth of the
    built-in building, else the built one."""
    return project.layout.true_map or built_map(project)


def refuse_own_depth(map: Path, project: Project) -> None:
    """Raises InputError for a map that was made of the depth which the project's own models render, or models of the
    same trajectory: it has their mistakes, and would find them right."""
    said = read_provenance(map)
    if said is None or said.source != "trained":
        return
    if set(said.makers) & set(makers_of(project.need_capture(), project)):
        raise InputError(
            f"{map} was made of the rendered depth of this project's own models, so it cannot judge them; "
            "build a map with `nvsim occupancy build --source lidar`, depth or images."
        )
