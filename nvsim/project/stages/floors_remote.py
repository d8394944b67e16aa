"""Computes floor masks on workers that may be on other machines."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from nvsim.cluster.piece import Caller, Executor, SentFile, StorageNotShared, WorkCall
from nvsim.cluster.storage import StorageProbe
from nvsim.errors import InputError
from nvsim.events import Listener, Progress
from nvsim.files.atomic import make_folder, write_bytes
from nvsim.perception.failures import Failures
from nvsim.perception.segment import SegmentConfig, mask_path, segment_capture
from nvsim.project.config import FloorsConfig
from nvsim.project.floor_heights import floors_seen
from nvsim.project.floor_provider import choose
from nvsim.project.project import Project
from nvsim.project.stages.depths import depth_maps
from nvsim.project.stages.remote import ProjectSnapshot, do_frames_remote

_STAGE = "floors"


def segment_remote(
    executor: Executor,
    project: Project,
    making: dict[str, str],
    config: FloorsConfig,
    provider: list[object],
    listen: Listener,
) -> None:
    """Writes the missing masks of the project, as far as the cluster can compute them.

    making    places of the new results, see `Project.making`
    provider  key of the floor provider, which workers compare with theirs

    Raises InputError if a worker fails.
    """
    folder, count = make_folder(project.layout.masks), len(project.need_capture().frames)
    missing = [i for i in range(count) if not mask_path(folder, i).exists()]
    failures = Failures(folder)
    failures.remove_frames(missing)
    done = count - len(missing)
    snapshot = ProjectSnapshot.of(project, making)

    def receive(file: SentFile) -> None:
        nonlocal done
        number, _, failure = file.name.partition(" ")
        index = int(number) if number.isdecimal() else -1
        if index not in missing:
            raise InputError(f"A worker sent the unexpected file {file.name!r}; check who runs this worker.")
        if failure:
            failures.add(index, failure)  # type: ignore[arg-type]  # readers skip invalid values
        write_bytes(mask_path(folder, index), file.data)
        done += 1
        listen(Progress(_STAGE, done, count, project.need_capture().frames[index].name))

    def order(frames: list[int], threads: int) -> WorkCall:
        left = [i for i in frames if not mask_path(folder, i).exists()]
        return WorkCall(segment_there, (snapshot, config, provider, left, threads))

    do_frames_remote(executor, project, _STAGE, missing, order, receive, listen)


def segment_there(
    caller: Caller,
    snapshot: ProjectSnapshot,
    config: FloorsConfig,
    provider: list[object],
    frames: Sequence[int],
    threads: int,
    probe: StorageProbe,
) -> StorageNotShared | None:
    """Runs on a worker: segments frames and sends their masks. The name of a mask is the number of the frame and the
    kind of failure, if any. Raises InputError if this machine has other networks installed than the caller."""
    missing = probe.missing()
    if missing:
        return StorageNotShared(missing)
    with snapshot.open() as project, tempfile.TemporaryDirectory(prefix="nvsim-floors-") as name:
        found = choose(config, project.scan)
        if found.key() != provider:
            raise InputError("The machines of the cluster have different networks; install equal ones on all machines.")
        capture, floors = replace(project.need_capture(), cloud=project.scan()), floors_seen(project)
        failures = segment_capture(
            capture,
            floors.__getitem__,
            Path(name),
            SegmentConfig(threads=threads),
            caller.send_event,
            frames,
            depth_maps(project),
            found.open(capture, caller.send_event),
        )
        for index in frames:
            failed = failures.get(index, "")
            caller.send(f"{index} {failed}".rstrip(), mask_path(Path(name), index).read_bytes())
    return None
