"""Poses before the import: a video or photographs become a capture in the project, with poses and points. If the source
lists posed panoramas, their perspective views do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.footage.cut_options import CutOptions, not_panoramic
from nvsim.project.project import Project
from nvsim.reconstruction.computing import compute_poses, discard, is_begun_for_others, is_finished
from nvsim.reconstruction.footage_check import footage_at
from nvsim.reconstruction.posed_panoramas import belongs_to, cut_posed_panoramas, find_posed_panoramas, is_used
from nvsim.reconstruction.report import REPORT

_MOST = 1000  # folders of poses in a project


def run(project: Project, source: Path, listen: Listener, model: str = "", options: CutOptions | None = None) -> Path:
    """The capture to import for `source`: `source` itself, or if that is a video or photographs, the folder in the
    project where the poses are, which are computed if they are missing. If `source` lists posed panoramas, the folder
    in the project with their views. `model` is the piece that the user wants, "" for the largest. `options` say how
    panoramas are cut; None uses the newest that are there. Raises InputError if the poses cannot be computed, and if
    there are `options` and no panoramas."""
    panoramas = find_posed_panoramas(source.expanduser())
    if panoramas is not None:
        file = panoramas
        folder = _folder_for(project, lambda at: belongs_to(at, file, options))
        if not is_used(folder):
            discard(folder)  # unfinished poses of a video
        cut_posed_panoramas(file, folder, listen, options)
        return folder
    footage = footage_at(source.expanduser())
    if footage is None:
        if options is not None:
            raise not_panoramic(source)
        return source
    videos = footage
    folder = _folder_for(project, lambda at: is_finished(at, videos, options))
    if is_begun_for_others(folder, footage):
        discard(folder)
    compute_poses(footage.source, folder, listen, chosen=bool(model), options=options)
    return folder


def _folder_for(project: Project, is_finished: Callable[[Path], bool]) -> Path:
    """The newest folder whose poses are finished for the same files, or the first one without finished poses.
    Finished poses of other videos stay, because a result that can be restored may use their images."""
    folders = [project.layout.poses(number) for number in range(1, _MOST + 1)]
    used = [folder for folder in folders if (folder / REPORT).exists() or is_used(folder)]
    same = next((folder for folder in reversed(used) if is_finished(folder)), None)
    if same is not None:
        return same
    free = next((folder for folder in folders if folder not in used), None)
    if free is None:
        raise InputError(f"{project.layout.root} holds the poses of {_MOST} videos; use another project.")
    return free
