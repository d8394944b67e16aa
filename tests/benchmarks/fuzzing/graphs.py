"""Connectivity files and the files next to them, evidence, edits in text form, and journals of edits."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from fuzzing.captures import cloud_samples
from fuzzing.maps import map_samples
from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, content, each, files_in
from nvsim.graph.connectivity import list_scan, read_connectivity, write_connectivity
from nvsim.graph.edits import EditError
from nvsim.graph.expression import by_expression
from nvsim.graph.findings import check_graph
from nvsim.graph.foreign import ForeignFile, connectivity_files
from nvsim.graph.history import History
from nvsim.graph.journal import Journal, sidecar
from nvsim.graph.operation_table import OPERATIONS
from nvsim.graph.operations import parse_line, perform_operation
from nvsim.graph.scripts import script
from nvsim.graph.store import decode_evidence, decode_graph, encode_evidence, encode_graph
from nvsim.graph.types import Evidence, NavGraph, SecondOpinion, Viewpoint, edge


def readers() -> list[Reader]:
    return [
        Reader("connectivity", _connectivity, _open, share=2),
        Reader("connectivity export", _connectivity, _read_own),
        Reader("scans list", _scans, _scan_files),
        Reader("review notes", _notes, _open),
        Reader("panorama beside", _pictures, _panorama),
        Reader("map and cloud beside", _beside, _look_beside),
        Reader("evidence", _evidence, _decode_evidence, share=2),
        Reader("graph blob", _blob, _decode_graph, share=2),
        Reader("edit script", _script, _replay, share=2, refusals=(EditError,)),
        Reader("expression", _expressions, _select, share=2, refusals=(EditError,)),
        Reader("journal", _journal, _restore, disposable=True, share=3),
        Reader("foreign journal", _foreign_journal, _restore_foreign, disposable=True),
    ]


def row(count: int = 6):
    """A row of `count` viewpoints with evidence for two of its edges."""
    ids = [f"v{i}" for i in range(count)]
    viewpoints = {id: Viewpoint(id, (2.0 * i, i / 3, 1.5)) for i, id in enumerate(ids)}
    cells = np.arange(12, dtype=np.uint8).reshape(4, 3)
    found = [
        Evidence("v1", 8, 0.1, 2.0, cells, cells, cells > 3, 0.05, 0.1, 0.9, 0, (4.0, 0.5), "v2", "open"),
        Evidence("v4", 0, 0.1, 2.0, cells, cells, cells > 5, 0.05, 0.1, 0.9, 0, (4.0, 0.5), "", "alpha"),
    ]
    second = SecondOpinion(1, cells, cells, None, cells)
    found.append(replace(found[1], direction=1, decision="disputed", reach=cells, mass=cells, second=second))
    edges = {(a, b): edge(a, b) for a, b in zip(ids, ids[1:], strict=False)}
    return NavGraph("row", viewpoints, edges, {e.key: e for e in found}, {"long v0": "a ramp"})


_FILE, _NOTES = "row_connectivity.json", "row_review.json"


def _files() -> dict[str, bytes]:
    with workshop() as folder:
        write_connectivity(row(), folder, lambda a, b: a.id < b.id)
        files = files_in(folder)
    notes = {"ignored": {"long v0": "a ramp"}, "reviewed": {"viewpoints": ["v1"], "edges": [["v1", "v2"]]}}
    return {**files, _NOTES: json.dumps({**notes, "locked": {"viewpoints": ["v2"], "edges": []}}).encode()}


def _connectivity() -> list[Seed]:
    return each(_files(), _FILE, {_FILE: "json"})


def _open(path: Path) -> object:
    """Opens a file as `nvsim graph check` and the window do."""
    file = ForeignFile.open(path)
    return file.text(), file.visibility(), check_graph(file.graph, file.context())


def _read_own(path: Path) -> object:
    return read_connectivity(path)


def _scans() -> list[Seed]:
    return each(_files(), "", {"scans.txt": "text"})


def _scan_files(path: Path) -> object:
    found = connectivity_files(path)
    list_scan(path / "scans.txt", "another")
    return found


def _notes() -> list[Seed]:
    return each(_files(), _FILE, {_NOTES: "json"})


def _pictures() -> list[Seed]:
    ramp = np.add.outer(np.arange(8), np.arange(48)).astype(np.uint8)
    strip = cv2.imencode(".jpg", np.dstack([ramp] * 3))[1].tobytes()
    files = {**_files(), "v1_skybox_small.jpg": strip}
    files |= {f"matterport_skybox_images/{n}": strip for n in ("v1_skybox_small.jpg",)}
    targets = {n: "picture" for n in files if n.endswith(".jpg")}
    return each(files, _FILE, targets)


def _panorama(path: Path) -> object:
    return ForeignFile.open(path).panorama("v1", 64)


def _beside() -> list[Seed]:
    cloud = next(data for name, data in cloud_samples().items() if name.startswith("binary_little"))
    files = {**_files(), **map_samples(), "cloud.ply": cloud}
    return each(files, _FILE, {"map.yaml": "text", "map.pgm": "picture", "cloud.ply": "headed"})


def _look_beside(path: Path) -> object:
    """Checks a graph against its map, as `nvsim graph check` does."""
    file = ForeignFile.open(path)
    occupancy = file.nearby_files.occupancy()
    return file.nearby_files.points(), check_graph(file.graph, file.context(occupancy=occupancy))


def _evidence() -> list[Seed]:
    return [Seed({"e": encode_evidence(e)}, "e", "e", "evidence") for e in row().evidence.values()]


def _decode_evidence(path: Path) -> object:
    return decode_evidence(content(path))


def _blob() -> list[Seed]:
    return [Seed({"g": encode_graph(row())}, "g", "g", "zip")]


def _decode_graph(path: Path) -> object:
    return encode_graph(decode_graph(content(path)))


_LINES = (
    '{"edit": "move_viewpoints", "positions": {"v2": [4.0, 1.0, 1.5]}}',
    '{"edit": "remove_viewpoints", "ids": ["v4"]}',
    '{"edit": "ignore_finding", "key": "long v0", "reason": "a ramp"}',
    '{"edit": "add_viewpoint", "position": [1.0, 1.0, 1.5]}',
    '{"edit": "rename_viewpoint", "old": "v3", "new": "door"}',
    '{"edit": "remove_edges", "pairs": [["v0", "v1"]]}',
    '{"edit": "add_edges", "pairs": [["v0", "v2"]]}',
    '{"edit": "patch", "viewpoints": [{"id": "n", "position": [0, 1, 1.5]}], "edges": [{"a": "n", "b": "v0"}]}',
)


def _script() -> list[Seed]:
    usual = [json.dumps({"edit": name, **_arguments(op)}) for name, op in OPERATIONS.items()]
    lines = [Seed({"s": f"{line}\n".encode()}, "s", "s", "lines of json") for line in (*_LINES, *usual)]
    return [Seed({"s": ("# all\n" + "\n".join(_LINES)).encode()}, "s", "s", "lines of json"), *lines]


def _arguments(operation) -> dict[str, object]:
    """A value for every argument of an operation, valid or not."""
    samples: dict[str, object] = {
        "id": "v1",
        "ids": ["v1", "v2"],
        "pairs": [["v0", "v1"]],
        "position": [1.0, 2.0, 1.5],
        "a": "v0",
        "b": "v3",
        "positions": {"v1": [2.0, 1.0, 1.5]},
        "key": "x",
        "reason": "y",
        "old": "v0",
        "new": "w",
        "text": "t",
    }
    return {a.name: samples.get(a.name, a.default if not a.needed else 1.0) for a in operation.arguments}


def _replay(path: Path) -> object:
    """Replays edits line by line, as `nvsim graph replay` does."""
    history, refused = History(row()), None
    for line in content(path).decode("utf-8", "surrogateescape").splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            try:
                perform_operation(history, *parse_line(line))
            except EditError as error:
                refused = error
    script(history)
    if refused is not None:
        raise refused
    return history.graph


def _expressions() -> list[Seed]:
    texts = (
        'degree > 4 and origin == "person"',
        "height + 1 * 2 - abs(z) / 3 < 7 or not included",
        'id in ("v1", "v2") and x >= -1.5 and submap == 0',
        "1 < degree <= 3 and (locked or reviewed)",
        "length > 1 and evidence > 0.2",
    )
    return [Seed({"e": t.encode()}, "e", "e", "text") for t in texts]


def _select(path: Path) -> object:
    return by_expression(row(), content(path).decode("utf-8", "surrogateescape"))


def _edited(path: Path, plain: bool) -> None:
    with Journal.open(path, plain=plain) as journal:
        history = journal.history(row())
        for line in _LINES:
            perform_operation(history, *parse_line(line))
        history.undo()
        journal.flush()


def _database(path: Path) -> bytes:
    """The content of a database file after its write-ahead log is merged into it."""
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.execute("PRAGMA journal_mode=DELETE")
    connection.close()
    return path.read_bytes()


def _journal() -> list[Seed]:
    with workshop() as folder:
        _edited(folder / "edits.db", False)
        return each({"edits.db": _database(folder / "edits.db")}, "edits.db", {"edits.db": "sqlite"})


def _restore(path: Path) -> object:
    return _restored(path, False)


def _restored(path: Path, plain: bool) -> object:
    """Restores a journal and continues editing, as the window does."""
    with Journal.open(path, plain=plain) as journal:
        history = journal.history(row())
        for index in range(len(history.steps)):
            history.graph_at(index)
        script(history)
        perform_operation(history, "add_viewpoint", {"position": [9.0, 9.0, 1.5]})
        journal.flush()
        return journal.notice


def _foreign_journal() -> list[Seed]:
    with workshop() as folder:
        path = sidecar(folder / _FILE)
        _edited(path, True)
        return each({path.name: _database(path)}, path.name, {path.name: "sqlite"})


def _restore_foreign(path: Path) -> object:
    return _restored(path, True)
