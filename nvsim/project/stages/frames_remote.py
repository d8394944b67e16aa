"""Processes the frames of a stage on workers that may be on other machines, several frames per piece. The workers read
the project and its images from shared storage. They send back files, which this process writes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing

from nvsim.cluster.config import Storage
from nvsim.cluster.piece import Executor, Finished, Order, Piece, SentFile, StorageNotShared
from nvsim.cluster.storage import StorageProbe
from nvsim.errors import InputError
from nvsim.events import Listener, Log, Warning, Worker
from nvsim.project.project import Project
from nvsim.project.stages.training_pool import BASE_BYTES

_POINT_BYTES = 200  # per point of a point cloud: the point, a search tree, and its neighbors
_FRAME_BYTES = 200 << 20  # cached data of frames


def do_frames_remote(
    executor: Executor,
    storage: Storage,
    project: Project,
    stage: str,
    frames: Sequence[int],
    order: Callable[[list[int], int], Order],
    receive: Callable[[SentFile], None],
    listen: Listener,
) -> None:
    """Distributes `frames` to the workers, and passes each returned file to `receive`.

    `order` returns the work for some frames with a number of threads; the last argument of this work is a StorageProbe.
    If the machines cannot read the project, no frame is processed and the user is told. Raises InputError if a worker
    fails, or storage that must be shared is not.
    """
    if not frames:
        return
    if storage == "sent":
        _say_alone("There is no shared storage", stage, listen)
        return
    machines = executor.machines
    threads = min(2, max(machines, default=1))
    count = max(1, min(len(frames), sum(cores // threads for cores in machines)))
    chunks = [list(frames[i * len(frames) // count : (i + 1) * len(frames) // count]) for i in range(count)]
    cloud = project.scan() if stage == "floors" else None
    needed = BASE_BYTES + _FRAME_BYTES + _POINT_BYTES * (0 if cloud is None else len(cloud.points))
    pieces = [Piece(stage, c[0], f"frames {c[0]} to {c[-1]}", threads, needed) for c in chunks]
    of_piece = dict(zip([p.part for p in pieces], chunks, strict=True))
    probe = StorageProbe.create_in(project.layout.checkpoints, project.need_capture().frames[0].image_path)

    def begin(piece: Piece) -> Order:
        made = order(of_piece[piece.part], threads)
        return Order(made.work, (*made.given, probe))

    try:
        with closing(executor.run(pieces, begin)) as messages:
            for _, message in messages:
                if isinstance(message, StorageNotShared):
                    if storage == "shared":
                        raise InputError(f"{message.why}; share it with all machines under the same path.")
                    _say_alone(message.why, stage, listen)
                    return
                if isinstance(message, SentFile):
                    message.check()
                    receive(message)
                elif isinstance(message, Log | Warning | Worker):
                    listen(message)
                else:
                    assert not isinstance(message, Finished) or message.value is None
    finally:
        probe.remove()


def _say_alone(why: str, stage: str, listen: Listener) -> None:
    listen(Log(f"{why}: this machine runs this stage alone.", stage))
