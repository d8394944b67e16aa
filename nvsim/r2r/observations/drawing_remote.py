"""Draws the images of viewpoints with workers, which may run on other machines.

Each worker gets a few viewpoints of one submap, and the submap's model as a path or as files. It sends the images back,
and this process writes them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cluster.config import Storage
from nvsim.cluster.piece import Caller, Executor, Finished, Order, Piece, SentFile, StorageNotShared
from nvsim.cluster.sharing import threads_each
from nvsim.errors import InputError, shown
from nvsim.events import Listener, Log, Progress, Warning, Worker
from nvsim.graph.types import Viewpoint
from nvsim.project.stages.training_pool import BASE_BYTES, GAUSSIAN_BYTES
from nvsim.r2r.observations.places import ScanPlaces
from nvsim.r2r.observations.record import Part, written
from nvsim.r2r.observations.settings import ScanSettings
from nvsim.r2r.observations.source import Source
from nvsim.r2r.observations.viewpoint_files import Painter, encode_images
from nvsim.render.backends import Backend
from nvsim.splats.files import count_of, load_model

if TYPE_CHECKING:
    from nvsim.r2r.observations.drawing import Todo

_STAGE = "scan"
_MOST = 16  # viewpoints of a piece: about ten seconds of drawing for one second of loading the model


def draw_on_workers(
    executor: Executor,
    storage: Storage,
    source: Source,
    todo: Sequence[Todo],
    places: ScanPlaces,
    settings: ScanSettings,
    backend: Backend,
    listen: Listener,
) -> Iterator[tuple[str, Part]]:
    """Yields viewpoint ids and their files after these are on disk. `todo` is in the order of submaps.

    Raises InputError if a model is unreadable, writing fails, or a worker sends an unexpected file or viewpoint.
    """
    size = max(1, min(_MOST, -(-len(todo) // max(1, 2 * sum(executor.machines)))))
    chunks = _chunks(todo, size)
    threads = threads_each(executor.machines, len(chunks))
    pieces = []
    for number, chunk in enumerate(chunks):
        gaussians = count_of(source.folders[chunk[0][0]])
        words = f"{len(chunk)} viewpoints of submap {chunk[0][0]}"
        pieces.append(Piece(_STAGE, number, words, threads, BASE_BYTES + gaussians * GAUSSIAN_BYTES))
    keys = {viewpoint.id: key for _, viewpoint, key in todo}
    arrived: dict[int, list[tuple[Path, bytes]]] = {}
    finished: set[str] = set()
    sent = storage == "sent"

    def begin(piece: Piece) -> Order:
        arrived[piece.part] = []
        left = tuple(v for _, v, _ in chunks[piece.part] if v.id not in finished)
        folder = source.folders[chunks[piece.part][0][0]]
        model = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()} if sent else folder
        return Order(draw_there, (model, left, places.scan, settings, backend))

    with closing(executor.run(pieces, begin)) as messages:
        for piece, message in messages:
            if isinstance(message, StorageNotShared):
                if storage == "shared":
                    raise InputError(f"{message.why}; share that folder with all machines, or use --storage sent.")
                sent = True
            elif isinstance(message, SentFile):
                message.check()
                if not places.holds(message.name):
                    raise InputError(f"A worker sent {message.name!r}, which is not an image; check that worker.")
                arrived[piece.part].append((places.root / message.name, message.data))
            elif isinstance(message, Progress):  # reports the viewpoint whose files have just arrived
                if all(message.detail != viewpoint.id for _, viewpoint, _ in chunks[piece.part]):
                    raise InputError(
                        f"A worker sent images of the viewpoint {shown(message.detail)}, which it was not asked for; "
                        "check that worker."
                    )
                files, arrived[piece.part] = arrived[piece.part], []
                finished.add(message.detail)
                yield message.detail, written(places.root, files, keys[message.detail])
            elif isinstance(message, Log | Warning | Worker):
                listen(message)
            else:
                assert isinstance(message, Finished)


def _chunks(todo: Sequence[Todo], size: int) -> list[list[Todo]]:
    """Splits `todo` into lists of at most `size` viewpoints of one submap each."""
    found = []
    for _, group in groupby(todo, key=lambda row: row[0]):
        rows = list(group)
        found += [rows[i : i + size] for i in range(0, len(rows), size)]
    return found


def draw_there(
    caller: Caller,
    model: Path | dict[str, bytes],
    viewpoints: Sequence[Viewpoint],
    scan: str,
    settings: ScanSettings,
    backend: Backend,
) -> StorageNotShared | None:
    """Runs on the worker: draws viewpoints with the model in a folder or in these files, and sends the images."""
    with tempfile.TemporaryDirectory(prefix="nvsim-scan-") as name:
        if isinstance(model, dict):
            folder = Path(name)
            for file, data in model.items():
                (folder / file).write_bytes(data)
        else:
            folder = model
            if not (folder / "model.json").is_file():
                return StorageNotShared(str(folder))
        loaded = load_model(folder)
        painter, places = Painter(settings, backend), ScanPlaces(Path(name), scan)
        for i, viewpoint in enumerate(viewpoints):
            for path, data in encode_images(painter.draw(loaded, viewpoint), viewpoint, settings, places):
                caller.send(path.relative_to(places.root).as_posix(), data)
            caller.tell(Progress(_STAGE, i + 1, len(viewpoints), viewpoint.id))
    return None
