"""Measures how fast a large graph is edited, checked, opened and saved: the work of the window without painting."""

from __future__ import annotations

import gc
import math
import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.difference import difference
from nvsim.graph.edits import EditError
from nvsim.graph.findings import Context, Validator
from nvsim.graph.foreign import ForeignFile
from nvsim.graph.history import History
from nvsim.graph.journal import Journal
from nvsim.graph.operations import perform_operation
from nvsim.graph.selection import select_within
from nvsim.graph.store import decode_evidence, encode_evidence
from nvsim.graph.types import Evidence, NavGraph, Viewpoint, edge
from nvsim.occupancy.types import FREE, OCCUPIED, OccupancyMap

_SPACING = 2.0  # approximate distance between neighbors in meters


def random_graph(viewpoints: int = 10_000, edges: int | None = None, directions: int = 0, seed: int = 0) -> NavGraph:
    """Random viewpoints on one floor, joined to their nearest neighbors. There are `edges` edges (four per viewpoint if
    None), and each viewpoint has evidence in `directions` directions."""
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    side = _SPACING * math.sqrt(viewpoints)
    places = np.column_stack([rng.uniform(0, side, (viewpoints, 2)), np.full(viewpoints, 1.5)])
    ids = [rng.bytes(16).hex() for _ in range(viewpoints)]
    distance, near = cKDTree(places).query(places, k=min(viewpoints, 13))
    pairs = {
        (min(i, j), max(i, j)): d
        for i, (row, meters) in enumerate(zip(near.tolist(), distance.tolist(), strict=True))
        for j, d in zip(row, meters, strict=True)
    }
    chosen = sorted((d, pair) for pair, d in pairs.items() if pair[0] != pair[1])
    made = [edge(ids[i], ids[j]) for _, (i, j) in chosen[: 4 * viewpoints if edges is None else edges]]
    cells = np.zeros((29, 18), np.uint8)
    measured = (
        Evidence(id, k, 0.8 * k, 2.5, cells, cells, cells == 0, 0.05, 0.1, 0.9, 0, (0.0, 0.0))
        for id in ids
        for k in range(directions)
    )
    # Encoded and decoded as in a project: evidence that was read is written again without new packing.
    evidence = {e.key: decode_evidence(encode_evidence(e)) for e in measured}
    found = [Viewpoint(id, (x, y, z)) for id, (x, y, z) in zip(ids, places.tolist(), strict=True)]
    return NavGraph("bench", {v.id: v for v in found}, {e.key: e for e in made}, evidence)


def random_map(graph: NavGraph, seed: int = 0) -> OccupancyMap:
    """A free floor under the graph with one box of 3 x 3 cells of 0.2 m per 25 square meters."""
    rng, resolution = np.random.default_rng(seed), 0.2
    size = int(_SPACING * math.sqrt(len(graph.viewpoints)) / resolution) + 10
    cells = np.full((size, size), FREE, np.uint8)
    for r, c in rng.integers(0, size - 3, (math.ceil((size * resolution / 5) ** 2), 2)):
        cells[r : r + 3, c : c + 3] = OCCUPIED
    return OccupancyMap(cells, resolution, (-1.0, -1.0))


def measure(edits: int = 300, viewpoints: int = 10_000, seed: int = 0) -> dict[str, Any]:
    """Times of edits in a graph with `viewpoints` viewpoints.

    edit_p95_ms            95th percentile of a single edit: operation, step in the history, difference, findings
    edit_median_ms         its median
    slowest_edit           the slowest kind of edit, with slowest_edit_median_ms
    select_delete_undo_ms  the slowest of four actions, including findings: selecting a tenth of the graph by a box,
                           deleting it, undo, redo; also select_ms, delete_ms, undo_ms, redo_ms
    open_s, save_s         opening a connectivity file of 1,500 viewpoints, and saving it after an edit
    first_flush_s          the first write of the journal, which has its own thread

    The journal keeps writing during the measurements, as in the window.
    """
    graph = random_graph(viewpoints, directions=8, seed=seed)
    with tempfile.TemporaryDirectory() as name, Journal.open(Path(name) / "edits.db") as journal:
        history = journal.history(graph)
        validator = Validator(graph, Context(occupancy=random_map(graph, seed)))
        _ = graph.adjacency, graph.evidence_of  # the window has computed them before the first edit
        followed = [graph]
        perform_operation(history, "mark_reviewed", {"viewpoints": [next(iter(graph.viewpoints))]})
        before = time.perf_counter()
        journal.flush()  # the first write has the whole graph, once per opening
        first_flush = time.perf_counter() - before
        gc.collect()
        gc.freeze()
        collects = gc.isenabled()
        gc.disable()  # as the window does, which collects garbage while the user does nothing

        def follow() -> None:
            change = difference(followed[0], history.graph)
            validator.update(history.graph, change)
            followed[0] = history.graph

        single = _single_edits(history, follow, edits, random.Random(seed))
        many = _many_at_once(history, follow)
        gc.unfreeze()
        if collects:
            gc.enable()
    times = np.array([ms for ms, _ in single])
    kinds = {kind for _, kind in single}
    by_kind = {kind: float(np.median([ms for ms, k in single if k == kind])) for kind in kinds}
    slowest = max(by_kind, key=lambda kind: by_kind[kind])
    return {
        "edit_p95_ms": round(float(np.percentile(times, 95)), 2),
        "edit_median_ms": round(float(np.median(times)), 2),
        "slowest_edit": slowest,
        "slowest_edit_median_ms": round(by_kind[slowest], 2),
        "select_delete_undo_ms": round(max(many.values()), 2),
        **{f"{what}_ms": round(ms, 2) for what, ms in many.items()},
        **_file_times(seed),
        "first_flush_s": round(first_flush, 2),
        "viewpoints": len(graph.viewpoints),
        "edges": len(graph.edges),
        "evidence": len(graph.evidence),
    }


def _single_edits(
    history: History, follow: Callable[[], None], count: int, rng: random.Random
) -> list[tuple[float, str]]:
    """Time in milliseconds and kind of each random edit."""
    found: list[tuple[float, str]] = []
    while len(found) < count:
        graph = history.graph
        id = rng.choice(list(graph.viewpoints))
        joined = graph.neighbors(id)
        x, y, z = graph.viewpoints[id].position
        place = [x + rng.uniform(-1, 1), y + rng.uniform(-1, 1), z]
        near = rng.choice(joined) if joined else id
        kinds: dict[str, dict[str, Any]] = {
            "move_viewpoints": {"positions": {id: place}},
            "add_viewpoint": {"position": place},
            "remove_viewpoints": {"ids": [id]},
            "include": {"ids": [id], "included": False},
            "set_height": {"ids": [id], "height": 1.2},
            "mark_reviewed": {"viewpoints": [id], "edges": [[id, other] for other in joined]},
            "remove_edges": {"pairs": [[id, near]]},
            "split_edge": {"edge": [id, near]},
            "merge_viewpoints": {"ids": [id, near], "middle": True},
            "add_edges": {"pairs": [[id, (graph.neighbors(near) or (near,))[-1]]]},
        }
        kind = rng.choice(sorted(kinds))
        before = time.perf_counter()
        try:
            perform_operation(history, kind, kinds[kind])
        except EditError:
            continue
        follow()
        found.append((1000 * (time.perf_counter() - before), kind))
    return found


def _many_at_once(history: History, follow: Callable[[], None]) -> dict[str, float]:
    """Median milliseconds of four actions: selecting a tenth of the viewpoints by a box, deleting them, undo and
    redo."""
    found: dict[str, list[float]] = {"select": [], "delete": [], "undo": [], "redo": []}
    wanted = len(history.graph.viewpoints) // 10
    side = _SPACING * math.sqrt(wanted)
    for i in range(7):
        low, high = 3.0 * i, 3.0 * i + side
        box = [(low, low), (high, low), (high, high), (low, high)]

        def delete() -> None:
            perform_operation(history, "remove_viewpoints", {"ids": history.selection.viewpoints})

        def select(box: list[tuple[float, float]] = box) -> None:
            history.select(select_within(history.graph, box))

        for what, do in (("select", select), ("delete", delete), ("undo", history.undo), ("redo", history.redo)):
            before = time.perf_counter()
            do()
            follow()
            found[what].append(1000 * (time.perf_counter() - before))
        history.undo()
        follow()
    return {what: float(np.median(values)) for what, values in found.items()}


def _file_times(seed: int) -> dict[str, float]:
    """Median seconds to open a connectivity file, and to save it after one edit."""
    opened, saved = [], []
    with tempfile.TemporaryDirectory() as name:
        path = write_connectivity(random_graph(1500, seed=seed), Path(name))
        for i in range(3):
            before = time.perf_counter()
            file = ForeignFile.open(path)
            opened.append(time.perf_counter() - before)
            history = History(file.graph)
            id = list(file.graph.viewpoints)[i]
            perform_operation(history, "shift_viewpoints", {"ids": [id], "by": [0.5, 0.0, 0.0]})
            perform_operation(history, "remove_viewpoints", {"ids": [list(file.graph.viewpoints)[-1]]})
            before = time.perf_counter()
            file.save(history.graph)
            saved.append(time.perf_counter() - before)
    return {"open_s": round(float(np.median(opened)), 3), "save_s": round(float(np.median(saved)), 3)}
