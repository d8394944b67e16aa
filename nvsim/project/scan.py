"""The known surfaces of a building: the capture's LiDAR scan, its depth images, or depth estimated from the images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.project.stage_records import StageRecord, record

if TYPE_CHECKING:
    from nvsim.capture.types import Cloud
    from nvsim.project.project import Project

CLOUD = "cloud.ply"
"""File of the depth stage: the fused cloud of all depth."""
ADDED = "added.ply"
"""File of the depth stage if the capture has a LiDAR scan: points that the LiDAR scan lacks."""


def depth_in_use(project: Project) -> StageRecord | None:
    """The record of the project's depth. None if it was never estimated, was skipped, or belongs to another capture
    than the present one."""
    found, imported = record(project, "depth"), record(project, "import")
    if found is None or imported is None or "skipped" in found.summary:
        return None
    return found if found.summary.get("capture") == imported.key else None


def depth_maps(project: Project) -> Callable[[int], NDArray[np.float32]] | None:
    """A function from frame index to estimated depth, (h, w) float32, meters along the optical axis, 0 if unknown. None
    if there is no estimated depth, or if measured surfaces are available, which are more accurate."""
    if depth_in_use(project) is None or project.need_capture().is_measured:
        return None
    from nvsim.depth.files import read_depth

    return partial(read_depth, project.layout.depth)


def load_scan(project: Project) -> Cloud | None:
    """Loads the cloud that `Project.scan` returns."""
    capture = project.need_capture()
    scanned = capture.cloud
    if depth_in_use(project) is None:
        return scanned
    from nvsim.depth.cloud_file import as_cloud, read_cloud_file

    dense = scanned is not None and scanned.is_dense
    seen = as_cloud(read_cloud_file(project.layout.depth / (ADDED if dense else CLOUD)))
    if not len(seen.points):
        return scanned
    if capture.has_measured_depth:
        seen = replace(seen, kind="depth", normals=None)  # as accurate as a LiDAR scan, so used like one
    return _completed(scanned, seen) if scanned is not None and dense else seen


def _completed(scan: Cloud, added: Cloud) -> Cloud:
    from nvsim.capture.types import Cloud

    assert added.colors is not None  # depth has colors
    colors = None if scan.colors is None else np.concatenate([scan.colors, added.colors])
    points, normals = np.concatenate([scan.points, added.points]), None
    if added.normals is not None:
        normals = np.concatenate([np.zeros_like(scan.points), added.normals])
    return Cloud(points, colors, scan.kind, normals)
