"""Draws the images of all viewpoints from the models of a project, submap by submap, and the masks of unseen surfaces.

Only one model is in memory at a time. While one viewpoint is drawn, the previous one is encoded and written. Workers
on other machines get a few viewpoints of one submap, and the submap's model as a path or as files. They send the
images back, and this process writes them.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.cluster.piece import (
    Caller,
    Executor,
    SentFile,
    StorageNotShared,
    WorkCall,
    WorkItem,
    WorkResult,
    threads_each,
)
from nvsim.errors import InputError, value_text
from nvsim.events import Listener, Log, Progress, Warning, Worker
from nvsim.files import atomic
from nvsim.files.opening import read_bytes
from nvsim.geometry.directions import skybox
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.project.photographed import PhotographedDirections
from nvsim.project.project import Project
from nvsim.project.stages.training_pool import BASE_BYTES, GAUSSIAN_BYTES
from nvsim.project.work import missing_result_error
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings, png
from nvsim.r2r.observations.record import FinishedPart, ScanRecord, key_of, write_part
from nvsim.r2r.observations.skybox import Images, Painter, encode_images
from nvsim.render.backends import Backend, resolve_backend
from nvsim.splats.files import gaussian_count, load_model
from nvsim.splats.scene import SceneModel
from nvsim.submaps.split import Submap

STAGE = "scan"
MADE = 1
"""Version of the image generation. Images of an earlier version are drawn again."""

Todo = tuple[int, Viewpoint, str]  # submap, viewpoint, key
_MOST = 16  # viewpoints of a piece: about ten seconds of drawing for one second of loading the model


@dataclass(frozen=True, eq=False)
class ScanModels:
    """The models of a scan.

    scene    the trained models, one of them in memory at a time
    submaps  submaps that have a model
    folders  index of a submap -> folder of its model
    photographed  measures which directions the training images show; None without images
    """

    scene: SceneModel
    submaps: tuple[Submap, ...]
    folders: Mapping[int, Path]
    photographed: PhotographedDirections | None = None

    @cached_property
    def keys(self) -> Mapping[int, str]:
        """Index of a submap -> SHA-256 of its model's files, which are read completely."""
        return {i: _key(folder) for i, folder in self.folders.items()}

    @staticmethod
    def of(project: Project, graph: NavGraph) -> ScanModels:
        """Raises InputError if no model is trained, or the submap of a viewpoint has no model."""
        scene = project.scene(memory_budget=0)  # without a budget, only one model stays in memory
        if scene is None:
            raise missing_result_error(project.layout.root, "train")
        submaps = project.submaps_as_cut("train")
        trained = tuple(s for s in submaps if s.index in scene.indices)
        if len(trained) < len(submaps):
            for v in graph.viewpoints.values():
                nearest = min(submaps, key=lambda s: _distance(s, v))
                if nearest.index not in scene.indices:
                    raise InputError(
                        f"Submap {nearest.index}, which contains viewpoint {v.id}, has no model; run `nvsim train "
                        f"--project {project.layout.root}` first."
                    )
        folders = {i: project.layout.model(i) for i in scene.indices}
        photographed = None if project.capture() is None else PhotographedDirections(project, scene)
        return ScanModels(scene, trained, folders, photographed)


def _distance(submap: Submap, viewpoint: Viewpoint) -> float:
    return float(np.linalg.norm(submap.positions - viewpoint.position, axis=1).min())


def _key(folder: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(p for p in folder.iterdir() if p.is_file()):
        digest.update(path.name.encode())
        digest.update(read_bytes(path))
    return digest.hexdigest()


def drawn_of(graph: NavGraph) -> dict[str, Viewpoint]:
    """Returns the viewpoints of `graph` that have images, which are the included ones."""
    return {v.id: v for v in graph.viewpoints.values() if v.included}


def draw_viewpoints(
    source: ScanModels,
    viewpoints: Mapping[str, Viewpoint],
    places: ScanPlaces,
    settings: ScanSettings,
    record: ScanRecord,
    backend: Backend,
    listen: Listener,
    executor: Executor | None = None,
) -> None:
    """Draws and writes the viewpoints that `record` does not list as finished, on a cluster if `executor` is given.

    Raises InputError if a model is unreadable or writing fails.
    """
    todo = sorted(missing(source, viewpoints, settings, record, backend), key=lambda row: row[0])
    done = len(viewpoints) - len(todo)
    listen(Progress(STAGE, done, len(viewpoints)))
    if executor is not None and executor.remote:
        parts = draw_on_workers(executor, source, todo, places, settings, backend, listen)
    else:
        parts = _write_finished(source, todo, places, settings, backend)
    for id, part in parts:
        record.add(id, part)
        done += 1
        listen(Progress(STAGE, done, len(viewpoints), id))


def missing(
    source: ScanModels,
    viewpoints: Mapping[str, Viewpoint],
    settings: ScanSettings,
    record: ScanRecord,
    backend: Backend,
) -> Iterator[Todo]:
    """Yields the viewpoints that `record` does not list as finished from these models and settings."""
    how = {**asdict(settings), "plans": None, "backend": resolve_backend(backend), "made": MADE}
    for v in viewpoints.values():
        submap = source.scene.nearest(np.array(v.position))
        key = key_of(how, source.keys[submap], v.position)
        if not record.finished(v.id, key):
            yield submap, v, key


def _write_finished(
    source: ScanModels, todo: list[Todo], places: ScanPlaces, settings: ScanSettings, backend: Backend
) -> Iterator[tuple[str, FinishedPart]]:
    """Yields viewpoint ids and their files after these are on disk. At most two viewpoints are in memory."""

    def write(images: Images, viewpoint: Viewpoint, key: str) -> tuple[str, FinishedPart]:
        files = encode_images(images, viewpoint, settings, places)
        return viewpoint.id, write_part(places.root, files, key)

    painter = Painter(settings, backend)
    before: Future[tuple[str, FinishedPart]] | None = None
    with ThreadPoolExecutor(1, "write scan") as writer:
        for submap, viewpoint, key in todo:
            images = painter.draw(source.scene.model(submap), viewpoint)
            if before is not None:
                yield before.result()
            before = writer.submit(write, images, viewpoint, key)
        if before is not None:
            yield before.result()


def draw_on_workers(
    executor: Executor,
    source: ScanModels,
    todo: Sequence[Todo],
    places: ScanPlaces,
    settings: ScanSettings,
    backend: Backend,
    listen: Listener,
) -> Iterator[tuple[str, FinishedPart]]:
    """Yields viewpoint ids and their files after these are on disk. `todo` is in the order of submaps.

    Raises InputError if a model is unreadable, writing fails, or a worker sends an unexpected file or viewpoint.
    """
    size = max(1, min(_MOST, -(-len(todo) // max(1, 2 * sum(executor.machines)))))
    chunks = _chunks(todo, size)
    threads = threads_each(executor.machines, len(chunks))
    pieces = []
    for number, chunk in enumerate(chunks):
        gaussians = gaussian_count(source.folders[chunk[0][0]])
        words = f"{len(chunk)} viewpoints of submap {chunk[0][0]}"
        pieces.append(WorkItem(STAGE, number, words, threads, BASE_BYTES + gaussians * GAUSSIAN_BYTES))
    keys = {viewpoint.id: key for _, viewpoint, key in todo}
    arrived: dict[int, list[tuple[Path, bytes]]] = {}
    finished: set[str] = set()
    sent = executor.storage == "sent"

    def begin(piece: WorkItem) -> WorkCall:
        arrived[piece.part] = []
        left = tuple(v for _, v, _ in chunks[piece.part] if v.id not in finished)
        folder = source.folders[chunks[piece.part][0][0]]
        model = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()} if sent else folder
        return WorkCall(draw_on_worker, (model, left, places.scan, settings, backend))

    with closing(executor.run(pieces, begin)) as messages:
        for piece, message in messages:
            if isinstance(message, StorageNotShared):
                if executor.storage == "shared":
                    raise InputError(f"{message.reason}; share that folder with all machines, or use --storage sent.")
                sent = True
            elif isinstance(message, SentFile):
                message.check()
                if not places.is_image_of_scan(message.name):
                    raise InputError(f"A worker sent {message.name!r}, which is not an image; check that worker.")
                arrived[piece.part].append((places.root / message.name, message.data))
            elif isinstance(message, Progress):  # reports the viewpoint whose files have just arrived
                if all(message.detail != viewpoint.id for _, viewpoint, _ in chunks[piece.part]):
                    raise InputError(
                        f"A worker sent images of the viewpoint {value_text(message.detail)}, which it was not asked "
                        "for; check that worker."
                    )
                files, arrived[piece.part] = arrived[piece.part], []
                finished.add(message.detail)
                yield message.detail, write_part(places.root, files, keys[message.detail])
            elif isinstance(message, Log | Warning | Worker):
                listen(message)
            else:
                assert isinstance(message, WorkResult)


def _chunks(todo: Sequence[Todo], size: int) -> list[list[Todo]]:
    """Splits `todo` into lists of at most `size` viewpoints of one submap each."""
    found = []
    for _, group in groupby(todo, key=lambda row: row[0]):
        rows = list(group)
        found += [rows[i : i + size] for i in range(0, len(rows), size)]
    return found


def draw_on_worker(
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
            caller.send_event(Progress(STAGE, i + 1, len(viewpoints), viewpoint.id))
    return None


def write_unseen(source: ScanModels, graph: NavGraph, places: ScanPlaces, side: int) -> list[Path]:
    """Writes a mask for each included viewpoint with unseen pixels, as wide as its strip with faces of `side` pixels.
    Returns the paths. Raises InputError if a model is unreadable or writing fails."""
    assert source.photographed is not None
    drawn = [v for v in graph.viewpoints.values() if v.included]
    files = []
    for v in sorted(drawn, key=lambda v: source.scene.nearest(np.array(v.position))):
        shown = source.photographed.photographed_mask(np.array(v.position))
        if not shown.all():
            path = places.skyboxes.unseen(v.id)
            atomic.write_bytes(path, png(unseen_strip(shown, side)))
            files.append(path)
    return files


def unseen_strip(shown: NDArray[np.bool_], side: int) -> NDArray[np.uint8]:
    """(side, 6 * side) uint8, 255 for unseen pixels, from the photographed directions `shown` (6, S, S)."""
    strip = skybox([np.where(face, 0, 255).astype(np.uint8) for face in shown])
    rows = np.arange(side) * len(strip) // side
    columns = np.arange(6 * side) * len(strip) // side
    return np.asarray(strip[rows[:, None], columns], np.uint8)
