"""Computes poses before the import: a video or photographs become a capture in the project, with poses and points.
Posed panoramas become perspective views."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.footage.cut_options import CutOptions, not_panoramic
from nvsim.project.project import Project
from nvsim.reconstruction.computing import compute_poses, discard, has_poses_of_other_files, is_finished
from nvsim.reconstruction.footage_check import footage_at
from nvsim.reconstruction.pose_networks import SAME_NETWORKS, PoseNetworks
from nvsim.reconstruction.posed_panoramas import (
    cut_posed_panoramas,
    find_posed_panoramas,
    has_panorama_views,
    has_views_of,
)
from nvsim.reconstruction.report import REPORT

_MOST = 1000  # folders of poses in a project


def run(
    project: Project,
    source: Path,
    listen: Listener,
    model: str = "",
    options: CutOptions | None = None,
    networks: PoseNetworks = SAME_NETWORKS,
) -> Path:
    """The capture to import for `source`.

    For a video or photographs, it is the folder in the project with their poses, which are computed if missing. For
    posed panoramas, it is the folder in the project with their views. Otherwise, it is `source` itself.

    model    the piece of the video that the user wants, "" for the largest
    options  how to cut panoramas; None uses the newest existing views
    networks  the user's networks for features and people

    Raises InputError if the poses cannot be computed, or `options` are given for a source without panoramas,
    or `networks` for a source that needs no poses.
    """
    panoramas = find_posed_panoramas(source.expanduser())
    if panoramas is not None:
        networks.refuse_for_poses(source)
        file = panoramas
        folder = _folder_for(project, lambda at: has_views_of(at, file, options))
        if not has_panorama_views(folder):
            discard(folder)  # unfinished poses of a video
        cut_posed_panoramas(file, folder, listen, options)
        return folder
    footage = footage_at(source.expanduser())
    if footage is None:
        networks.refuse_for_poses(source)
        if options is not None:
            raise not_panoramic(source)
        return source
    videos = footage
    folder = _folder_for(project, lambda at: is_finished(at, videos, options, networks))
    if has_poses_of_other_files(folder, footage):
        discard(folder)
    compute_poses(footage.source, folder, listen, chosen=bool(model), options=options, networks=networks)
    return folder


def _folder_for(project: Project, is_finished: Callable[[Path], bool]) -> Path:
    """The newest folder with finished poses of these files, or the first folder without finished poses. Finished poses
    of other videos stay, because a result that can be restored may use their images."""
    folders = [project.layout.poses(number) for number in range(1, _MOST + 1)]
    used = [folder for folder in folders if (folder / REPORT).exists() or has_panorama_views(folder)]
    same = next((folder for folder in reversed(used) if is_finished(folder)), None)
    if same is not None:
        return same
    free = next((folder for folder in folders if folder not in used), None)
    if free is None:
        raise InputError(f"{project.layout.root} holds the poses of {_MOST} videos; use another project.")
    return free
