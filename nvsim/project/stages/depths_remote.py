"""Estimates the depth of frames on workers that may be on other machines."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from nvsim.cluster.piece import Caller, Executor, SentFile, StorageNotShared, WorkCall
from nvsim.cluster.storage import StorageProbe
from nvsim.depth.config import DepthConfig
from nvsim.depth.estimate import Elsewhere, FramesInPhases, Phase
from nvsim.depth.files import confidence_path, depth_path, draft_path
from nvsim.depth.planes import Plane
from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.files.atomic import make_folder, write_bytes
from nvsim.project.project import Project
from nvsim.project.stages.remote import ProjectSnapshot, do_frames_remote


def depth_remote(
    executor: Executor, project: Project, folder: Path, config: DepthConfig, listen: Listener
) -> Elsewhere:
    """A function that runs frames of a phase on a cluster, for `estimate_depth`, which writes to `folder`. The function
    raises InputError if a worker fails."""
    snapshot = ProjectSnapshot.of(project)

    def compute_remotely(phase: Phase, frames: list[int], planes: list[Plane], tell: Callable[[int], None]) -> None:
        whose = {path.relative_to(folder).as_posix(): i for i in frames for path in _files(folder, phase, i)}

        def receive(file: SentFile) -> None:
            if file.name not in whose:
                raise InputError(f"A worker sent the unexpected file {file.name!r}; check who runs this worker.")
            write_bytes(folder / file.name, file.data)
            if folder / file.name == _files(folder, phase, whose[file.name])[-1]:
                tell(whose[file.name])

        def order(some: list[int], threads: int) -> WorkCall:
            left = [i for i in some if not _files(folder, phase, i)[-1].is_file()]
            return WorkCall(compute_depth_on_worker, (snapshot, folder, config, phase, left, planes, threads))

        do_frames_remote(executor, project, "depth", frames, order, receive, listen)

    return compute_remotely


def compute_depth_on_worker(
    caller: Caller,
    snapshot: ProjectSnapshot,
    folder: Path,
    config: DepthConfig,
    phase: Phase,
    frames: Sequence[int],
    planes: Sequence[Plane],
    threads: int,
    probe: StorageProbe,
) -> StorageNotShared | None:
    """Runs on a worker: processes frames of a phase and sends their files, named by the path below the depth folder."""
    missing = probe.missing()
    if missing:
        return StorageNotShared(missing)
    with snapshot.open() as project, tempfile.TemporaryDirectory(prefix="nvsim-depth-") as name:
        out = Path(name)
        make_folder(out / phase)
        work = FramesInPhases(project.need_capture(), folder, config, planes)
        with ThreadPoolExecutor(threads) as pool:
            for index, _ in zip(frames, pool.map(partial(work.do, phase, out), frames), strict=True):
                for path in _files(out, phase, index):
                    caller.send(path.relative_to(out).as_posix(), path.read_bytes())
                    path.unlink()
    return None


def _files(folder: Path, phase: Phase, index: int) -> list[Path]:
    """The files of a frame of a phase, in the order in which they are written."""
    if phase == "finished":
        return [confidence_path(folder, index), depth_path(folder, index)]
    return [draft_path(folder / phase, index)]
