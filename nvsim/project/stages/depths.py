"""Estimates depth for captures without a LiDAR scan. Commits a depth map for each frame, from its depth image or
estimated, and the fused point cloud. If the capture has a LiDAR scan, depth is estimated only on request."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.cluster.piece import Executor
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning, ignore_event
from nvsim.files.frame_numbers import number_in, write_frame_names
from nvsim.project import ledger
from nvsim.project.config import DepthUse
from nvsim.project.earlier_results import report_replaced_result
from nvsim.project.layout import ADDED, CLOUD
from nvsim.project.project import Project
from nvsim.project.stages.imported import capture_key
from nvsim.project.state.results import NOWHERE
from nvsim.project.work import StageName

if TYPE_CHECKING:
    from nvsim.capture.types import Capture, Cloud
    from nvsim.depth.estimate import Elsewhere
    from nvsim.depth.fusion import FusedCloud

STAGE: StageName = "depth"
_VERSION = 6  # of the committed data; increased when equal inputs give another result
_BLOCK = 1 << 20  # points that are compared with the LiDAR scan at the same time
_HOLE = 0.15  # meters; a LiDAR scan has a hole at points that are farther than this from all of its points


def run(
    project: Project,
    use: DepthUse,
    config: DepthConfig,
    listen: Listener = ignore_event,
    executor: Executor | None = None,
) -> None:
    """Computes the depth of all frames if `use` asks for it: "auto" (if the capture has no LiDAR scan), "always" or
    "never".

    With "never", depth images are not used either. An interrupted run continues. If `executor` is a cluster whose
    machines can read the images, they share the work. Raises InputError if nothing is imported.
    """
    capture, imported = project.need_capture(), capture_key(project)
    reason = reason_without_depth(capture.cloud, use)
    key = ledger.key_of(STAGE, imported, use, config.key, _VERSION)
    if reason:
        key = ledger.key_of(STAGE, imported, use, reason, _VERSION)  # the options do not matter if depth is skipped
    if ledger.is_current(project, STAGE, key) and (reason or _is_whole(project, capture)):
        listen(Log(f"No depth is estimated: {reason}." if reason else "The depth is up to date.", STAGE))
        return
    if reason:
        _skip(project, key, {"skipped": reason, "use": use}, listen)
        return
    from nvsim.depth.cloud_file import write_cloud
    from nvsim.depth.estimate import estimate_depth

    report_replaced_result(project, STAGE, listen)
    resumed = ledger.begin_part(project, STAGE, key)
    folder = project.making(project.stage_results().made_at(STAGE)).layout.depth
    if not resumed:
        shutil.rmtree(folder, ignore_errors=True)
    started = time.monotonic()
    listen(Progress(STAGE, 0, 1))
    helped: Elsewhere | None = None
    if executor is not None and executor.remote:
        from nvsim.project.stages.depths_remote import depth_remote

        helped = depth_remote(executor, project, folder, config, listen)
    measured = len(capture.depth_of_frames)
    if measured:
        rest = "" if measured == len(capture.frames) else "; the depth of the others is estimated"
        listen(Log(f"The depth images of {measured} of {len(capture.frames)} frames are used{rest}.", STAGE))
    cloud = estimate_depth(capture, folder, config, listen, helped)
    summary = {"frames": len(capture.frames), "points": len(cloud.points), "use": use}
    if measured:
        summary["measured"] = measured
    if capture.cloud is not None and capture.cloud.is_dense:
        added = points_in_holes(cloud, capture.cloud)
        summary["added"] = len(added.points)
        write_cloud(folder / ADDED, added)
    write_cloud(folder / CLOUD, cloud)
    write_frame_names(folder, [frame.name for frame in capture.frames])
    ledger.finish(project, STAGE, time.monotonic() - started, summary)
    if not len(cloud.points):
        why = "the images share no visible surfaces, so obstacles on the floor are unknown without a LiDAR scan"
        listen(Warning(f"No point was found: {why}.", STAGE))
    more = f", {summary['added']} of them in holes of the LiDAR scan" if "added" in summary else ""
    listen(Done(STAGE, f"depth of {len(capture.frames)} frames, {len(cloud.points)} points{more}", summary))


def reason_without_depth(cloud: Cloud | None, use: DepthUse) -> str:
    """The reason, as a clause, to estimate no depth; "" if depth is estimated. `cloud` is that of the capture. A sparse
    cloud is not a reason, because it has no points on bare walls."""
    if use == "never":
        return "it is disabled by --depth never"
    return "the capture has a LiDAR scan" if use == "auto" and cloud is not None and cloud.is_dense else ""


def points_in_holes(cloud: FusedCloud, scan: Cloud) -> FusedCloud:
    """The points of `cloud` that fill holes of `scan`: those farther than 0.15 m from all of its points."""
    from scipy.spatial import cKDTree

    from nvsim.depth.fusion import FusedCloud

    tree, far = cKDTree(scan.points), np.zeros(len(cloud.points), bool)
    for start in range(0, len(far), _BLOCK):
        part = slice(start, start + _BLOCK)
        far[part] = np.isinf(tree.query(cloud.points[part], distance_upper_bound=_HOLE, workers=-1)[0])
    return FusedCloud(cloud.points[far], cloud.colors[far], cloud.normals[far], cloud.views[far])


def depth_maps(project: Project) -> Callable[[int], NDArray[np.float32]] | None:
    """A function from frame index to estimated depth, (h, w) float32, meters along the optical axis, 0 if unknown. None
    if there is no estimated depth, or if measured surfaces are available, which are more accurate."""
    if project.stage_results().depth is None or project.need_capture().is_measured:
        return None
    return partial(_depth_of, project.layout.depth, [frame.name for frame in project.need_capture().frames])


def _depth_of(folder: Path, names: list[str], index: int) -> NDArray[np.float32]:
    from nvsim.depth.files import read_depth

    return read_depth(folder, number_in(folder, names[index], index))


def _skip(project: Project, key: str, summary: dict[str, object], listen: Listener) -> None:
    """Records that no depth is estimated. A previous depth result is kept; a previous skip is not."""
    before = ledger.record(project, STAGE)
    keep = before is None or "skipped" not in before.summary
    ledger.begin_part(project, STAGE, key)
    ledger.finish(project, STAGE, 0.0, summary, files={STAGE: NOWHERE}, keep=keep)
    listen(Done(STAGE, f"no depth is estimated: {summary['skipped']}", summary))


def _is_whole(project: Project, capture: Capture) -> bool:
    """Whether all committed files exist; a user may have deleted damaged ones."""
    from nvsim.depth.estimate import depth_exists

    folder = project.layout.depth
    try:
        project.scan()
    except InputError:
        return False
    return (folder / CLOUD).is_file() and all(depth_exists(folder, i) for i in range(len(capture.frames)))
