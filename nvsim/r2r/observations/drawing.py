"""Draws the images of all viewpoints, submap by submap, so that only one model is in memory at a time.

While one viewpoint is drawn, the previous one is encoded and written.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict

import numpy as np

from nvsim.cluster.config import Storage
from nvsim.cluster.piece import Executor
from nvsim.events import Listener, Progress
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.observations.places import ScanPlaces
from nvsim.r2r.observations.record import Part, Record, key_of, written
from nvsim.r2r.observations.settings import ScanSettings
from nvsim.r2r.observations.source import Source
from nvsim.r2r.observations.viewpoint_files import Images, Painter, encode_images
from nvsim.render.backends import Backend, chosen

STAGE = "scan"
MADE = 1
"""Version of the image generation. Images of an earlier version are drawn again."""

Todo = tuple[int, Viewpoint, str]  # submap, viewpoint, key


def drawn_of(graph: NavGraph) -> dict[str, Viewpoint]:
    """Returns the viewpoints of `graph` that have images, which are the included ones."""
    return {v.id: v for v in graph.viewpoints.values() if v.included}


def draw_viewpoints(
    source: Source,
    viewpoints: Mapping[str, Viewpoint],
    places: ScanPlaces,
    settings: ScanSettings,
    record: Record,
    backend: Backend,
    listen: Listener,
    executor: Executor | None = None,
    storage: Storage = "auto",
) -> None:
    """Draws and writes the viewpoints that `record` does not list as finished, on a cluster if `executor` is given.

    Raises InputError if a model is unreadable or writing fails.
    """
    todo = sorted(missing(source, viewpoints, settings, record, backend), key=lambda row: row[0])
    done = len(viewpoints) - len(todo)
    listen(Progress(STAGE, done, len(viewpoints)))
    if executor is not None and executor.remote:
        from nvsim.r2r.observations.drawing_remote import draw_on_workers

        parts = draw_on_workers(executor, storage, source, todo, places, settings, backend, listen)
    else:
        parts = _written(source, todo, places, settings, backend)
    for id, part in parts:
        record.add(id, part)
        done += 1
        listen(Progress(STAGE, done, len(viewpoints), id))


def missing(
    source: Source, viewpoints: Mapping[str, Viewpoint], settings: ScanSettings, record: Record, backend: Backend
) -> Iterator[Todo]:
    """Yields the viewpoints that `record` does not list as finished from these models and settings."""
    how = {**asdict(settings), "plans": None, "backend": chosen(backend), "made": MADE}
    for v in viewpoints.values():
        submap = source.scene.nearest(np.array(v.position))
        key = key_of(how, source.keys[submap], v.position)
        if not record.finished(v.id, key):
            yield submap, v, key


def _written(
    source: Source, todo: list[Todo], places: ScanPlaces, settings: ScanSettings, backend: Backend
) -> Iterator[tuple[str, Part]]:
    """Yields viewpoint ids and their files after these are on disk. At most two viewpoints are in memory."""

    def write(images: Images, viewpoint: Viewpoint, key: str) -> tuple[str, Part]:
        files = encode_images(images, viewpoint, settings, places)
        return viewpoint.id, written(places.root, files, key)

    painter = Painter(settings, backend)
    before: Future[tuple[str, Part]] | None = None
    with ThreadPoolExecutor(1, "write scan") as writer:
        for submap, viewpoint, key in todo:
            images = painter.draw(source.scene.model(submap), viewpoint)
            if before is not None:
                yield before.result()
            before = writer.submit(write, images, viewpoint, key)
        if before is not None:
            yield before.result()
