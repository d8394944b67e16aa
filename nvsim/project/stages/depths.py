"""Depth: how far away everything in the images is, for captures that no scanner saw. Commits a depth map of every
frame, from its depth image or estimated, and the cloud that they make together; where there is a scan, nothing.
"""

from __future__ import annotations

import dataclasses
import shutil
import sqlite3
import time
from typing import TYPE_CHECKING

import numpy as np

from nvsim.cluster.config import Storage
from nvsim.cluster.piece import Executor
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Progress, Warning
from nvsim.project import ledger, results
from nvsim.project.config import DepthUse
from nvsim.project.project import Project
from nvsim.project.replaced import listen_to_what_is_replaced
from nvsim.project.scan import ADDED, CLOUD
from nvsim.project.stages.imported import capture_key
from nvsim.project.work import StageName

if TYPE_CHECKING:
    from nvsim.capture.types import Capture, Cloud
    from nvsim.depth.estimate import Elsewhere
    from nvsim.depth.fusion import FusedCloud

STAGE: StageName = "depth"
_VERSION = 5  # of what this stage commits; raised when the same inputs give something else
_HOLE = 0.15  # metres: what is farther than this from every point of a scan is missing in it


def run(
    project: Project,
    use: DepthUse,
    config: DepthConfig,
    listen: Listener,
    executor: Executor | None = None,
    storage: Storage = "auto",
) -> None:
    """Depth of all frames where `use` wants it: "auto" where the capture has no scan, "always", or "never", which does
    not use depth images either. Goes on where it was cut off. The machines of a cluster help where `executor` is one
    and they see the images."""
    capture, imported = project.need_capture(), capture_key(project)
    reason = why_not(capture.cloud, use)
    key = ledger.key_of(STAGE, imported, use, _same(config), _VERSION)
    if reason:
        key = ledger.key_of(STAGE, imported, use, reason, _VERSION)  # whatever the settings of what is not done
    if ledger.is_current(project, STAGE, key) and (reason or _is_whole(project, capture)):
        listen(Log(f"No depth is estimated: {reason}." if reason else "The depth is up to date.", STAGE))
        return
    if reason:
        _skip(project, key, {"skipped": reason, "use": use, "capture": imported}, listen)
        return
    from nvsim.depth.cloud_file import write_cloud
    from nvsim.depth.estimate import estimate_depth

    listen_to_what_is_replaced(project, STAGE, listen)
    resumed = ledger.begin(project, STAGE, key)
    folder = project.making(results.made_at(project.connection, STAGE)).layout.depth
    if not resumed:
        shutil.rmtree(folder, ignore_errors=True)
    started = time.monotonic()
    listen(Progress(STAGE, 0, 1))
    helped: Elsewhere | None = None
    if executor is not None and executor.remote:
        from nvsim.project.stages.depths_afar import depth_afar

        helped = depth_afar(executor, storage, project, folder, config, listen)
    measured = len(capture.depth_of_frames)
    if measured:
        rest = "" if measured == len(capture.frames) else "; the depth of the others is estimated"
        listen(Log(f"The depth images of {measured} of {len(capture.frames)} frames are used{rest}.", STAGE))
    cloud = estimate_depth(capture, folder, config, listen, helped)
    summary = {"frames": len(capture.frames), "points": len(cloud.points), "use": use, "capture": imported}
    if measured:
        summary["measured"] = measured
    if capture.cloud is not None and capture.cloud.is_dense:
        added = lacking(cloud, capture.cloud)
        summary["added"] = len(added.points)
        write_cloud(folder / ADDED, added)
    write_cloud(folder / CLOUD, cloud)
    ledger.finish(project, STAGE, time.monotonic() - started, summary)
    if not len(cloud.points):
        why = "the images have no depth in common; without a scan nothing says what stands on the floor"
        listen(Warning(f"No point was found: {why}.", STAGE))
    more = f", {summary['added']} of them where the scan has none" if "added" in summary else ""
    listen(Done(STAGE, f"depth of {len(capture.frames)} frames, {len(cloud.points)} points{more}", summary))


def why_not(cloud: Cloud | None, use: DepthUse) -> str:
    """Why no depth is estimated beside the capture's `cloud`, as a clause; "" where it is. A sparse cloud is no reason:
    it says nothing of bare walls."""
    if use == "never":
        return "it is told never to"
    return "the capture has a scan" if use == "auto" and cloud is not None and cloud.is_dense else ""


def lacking(cloud: FusedCloud, scan: Cloud) -> FusedCloud:
    """What of `cloud` fills holes of `scan`: the points farther than 0.15 m from each of its own."""
    from scipy.spatial import cKDTree

    from nvsim.depth.fusion import FusedCloud

    far = np.zeros(len(cloud.points), bool)
    if len(cloud.points):
        far = np.isinf(cKDTree(scan.points).query(cloud.points, distance_upper_bound=_HOLE, workers=-1)[0])
    return FusedCloud(cloud.points[far], cloud.colors[far], cloud.normals[far], cloud.views[far])


def _same(config: DepthConfig) -> DepthConfig:
    """The number of threads changes nothing."""
    return dataclasses.replace(config, threads=DepthConfig().threads)


def _skip(project: Project, key: str, summary: dict[str, object], listen: Listener) -> None:
    """Notes that no depth is estimated. A depth that was in use is kept; a skip before this one is not worth it."""
    before, kept = ledger.record(project, STAGE), results.kept(project.connection, STAGE)

    def write(c: sqlite3.Connection) -> None:
        results.put_places(c, results.places(c) | {STAGE: results.NOWHERE})
        if before is not None and "skipped" in before.summary:
            results.keep(c, STAGE, kept)

    ledger.begin(project, STAGE, key)
    ledger.finish(project, STAGE, 0.0, summary, write=write)
    listen(Done(STAGE, f"no depth is estimated: {summary['skipped']}", summary))


def _is_whole(project: Project, capture: Capture) -> bool:
    """Whether everything that the stage committed is there; somebody may have deleted what was damaged."""
    from nvsim.depth.estimate import depth_exists

    folder = project.layout.depth
    try:
        project.scan()
    except InputError:
        return False
    return (folder / CLOUD).is_file() and all(depth_exists(folder, i) for i in range(len(capture.frames)))
