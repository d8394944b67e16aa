"""Poses before the import: if the source is a video, its frames, poses and points become a capture in the project."""

from __future__ import annotations

from pathlib import Path

from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.footage.sources import Footage
from nvsim.project.project import Project
from nvsim.reconstruction.computing import compute_poses, discard, is_begun_for_others, is_finished
from nvsim.reconstruction.footage_check import footage_at
from nvsim.reconstruction.report import REPORT

_MOST = 1000  # folders of poses in a project


def run(project: Project, source: Path, listen: Listener, model: str = "") -> Path:
    """The capture to import for `source`: `source` itself, or if that is a video, the folder in the project where its
    poses are, which are computed if they are missing. `model` is the piece that the user wants, "" for the largest.
    Raises InputError if the poses cannot be computed."""
    footage = footage_at(source.expanduser())
    if footage is None:
        return source
    folder = _folder_for(project, footage)
    if is_begun_for_others(folder, footage):
        discard(folder)
    compute_poses(footage.source, folder, listen, chosen=bool(model))
    return folder


def _folder_for(project: Project, footage: Footage) -> Path:
    """Where the poses of these files are, or the first folder without finished poses. Finished poses of other videos
    stay, because a result that can be restored may use their images."""
    folders = [project.layout.poses(number) for number in range(1, _MOST + 1)]
    used = [folder for folder in folders if (folder / REPORT).exists()]
    same = next((folder for folder in used if is_finished(folder, footage)), None)
    if same is not None:
        return same
    free = next((folder for folder in folders if folder not in used), None)
    if free is None:
        raise InputError(f"{project.layout.root} holds the poses of {_MOST} videos; use another project.")
    return free
