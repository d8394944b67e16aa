"""What is known of the surfaces of a building: the capture's scan, its depth images, or the depth that was estimated
from the images."""

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
"""Of the depth stage's folder: all that the images show."""
ADDED = "added.ply"
"""Beside it where the capture has a scan: what the scan lacks."""


def depth_in_use(project: Project) -> StageRecord | None:
    """What the ledger says of the depth of the project's images; None where there is none: it was never estimated, was
    skipped, or is of another capture than there is now."""
    found, imported = record(project, "depth"), record(project, "import")
    if found is None or imported is None or "skipped" in found.summary:
        return None
    return found if found.summary.get("capture") == imported.key else None


def depth_maps(project: Project) -> Callable[[int], NDArray[np.float32]] | None:
    """What gives the estimated depth of a frame, (h, w) metres along the optical axis, 0 where unknown; None where
    there is none, or surfaces were measured, which the cloud shows better."""
    if depth_in_use(project) is None or project.need_capture().is_measured:
        return None
    from nvsim.depth.files import read_depth

    return partial(read_depth, project.layout.depth)


def load_scan(project: Project) -> Cloud | None:
    """See `Project.scan`."""
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
        seen = replace(seen, kind="depth", normals=None)  # as exact as a scan, so used like one
    return _completed(scanned, seen) if scanned is not None and dense else seen


def _completed(scan: Cloud, added: Cloud) -> Cloud:
    from nvsim.capture.types import Cloud

    assert added.colors is not None  # depth has colors
    colors = None if scan.colors is None else np.concatenate([scan.colors, added.colors])
    points, normals = np.concatenate([scan.points, added.points]), None
    if added.normals is not None:
        normals = np.concatenate([np.zeros_like(scan.points), added.normals])
    return Cloud(points, colors, scan.kind, normals)
