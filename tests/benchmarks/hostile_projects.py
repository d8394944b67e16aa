"""Malicious projects. Each function turns a harmless project into a malicious one."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sqlite3
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Bait:
    """canary  folder with files that must not change
    pipe    named pipe that must not be opened
    pid     process that must not receive a signal
    """

    canary: Path
    pipe: Path
    pid: int


Trap = Callable[[Path, Bait], None]
MARKUP = '<img src="{0}"><a href="file://{0}">x</a><b>bold</b>'


def _job(root: Path, number: int, verb: str, arguments: list[str], title: str = "Train", **standing: object) -> Path:
    folder = root / "logs" / "jobs" / f"{number:06d}"
    folder.mkdir(parents=True, exist_ok=True)
    order = {"verb": verb, "arguments": arguments, "title": title, "heavy": True, "ordered": 1.0, "proof": "0" * 64}
    (folder / "order.json").write_text(json.dumps(order))
    (folder / "standing.json").write_text(json.dumps({"state": "queued", **standing}))
    return folder


def _sql(database: Path, *statements: str) -> None:
    with contextlib.closing(sqlite3.connect(database)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


def queued_jobs(root: Path, bait: Bait) -> None:
    here, out = ["--project", str(root)], str(bait.canary)
    _job(root, 1, "export r2r", [*here, "--force", "--out", out])
    _job(root, 2, "map", ["--tyro-write-completion", "bash", f"{out}/completion"])
    _job(root, 3, "graph log", [str(root), "--script", f"{out}/precious"])
    _job(root, 4, "evaluate graph", [*here, "--picture", f"{out}/picture.png", "--occupancy", str(bait.pipe)])
    _job(root, 5, "floors", [*here, "--discard-corrections"], state="interrupted")
    _job(root, 6, "submaps", here, state="paused")


def foreign_process(root: Path, bait: Bait) -> None:
    for number in (1, 2):
        folder = _job(
            root, number, "train", ["--project", str(root)], state="running", pid=bait.pid, started=time.time()
        )
        (folder / "worker.lock").touch()
        (folder / "wish").write_text("cancel")


def smuggling_history(root: Path, bait: Bait) -> None:
    from nvsim.graph.journal import Journal
    from nvsim.graph.operations import perform_operation
    from nvsim.project.project import Project

    with Project.open(root) as project:
        graph = project.need_graph()
    with Journal.open(root / "edits.db") as journal:
        perform_operation(journal.history(graph), "remove_edges", {"pairs": [list(next(iter(graph.edges)))]})
        journal.flush()
    wild = json.dumps({"edit": "shell", "command": f"touch {bait.canary}/run"})
    _sql(
        root / "edits.db", f"UPDATE steps SET operation = '{wild}', text = 'a' || char(10) || 'touch {bait.canary}/run'"
    )


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT {} FROM n"


def views(root: Path, bait: Bait) -> None:
    columns = "i AS name, 0.0 AS created, '' AS figures"
    _sql(root / "project.db", "DROP TABLE results", f"CREATE VIEW results AS {ENDLESS.format(columns)}")


def views_in_history(root: Path, bait: Bait) -> None:
    smuggling_history(root, bait)
    _sql(root / "edits.db", "DROP TABLE marks", f"CREATE VIEW marks AS {ENDLESS.format('i AS name, i AS value')}")


def triggers(root: Path, bait: Bait) -> None:
    _sql(root / "project.db", "CREATE TRIGGER t AFTER INSERT ON results BEGIN DELETE FROM viewpoints; END")


def damaged_pages(root: Path, bait: Bait) -> None:
    path = root / "project.db"
    whole = path.read_bytes()
    path.write_bytes(whole[:4096] + b"\xff" * 4096 + whole[8192:])


def empty_database(root: Path, bait: Bait) -> None:
    (root / "project.db").write_bytes(b"")


def wrong_cells(root: Path, bait: Bait) -> None:
    _sql(root / "project.db", "UPDATE viewpoints SET x = 'abc'", "INSERT INTO results VALUES ('a', 'b', 'c')",
         "UPDATE meta SET value = zeroblob(9)")  # fmt: skip


def links(root: Path, bait: Bait) -> None:
    """Replaces output paths by links to missing and to existing files."""
    jobs = root / "logs" / "jobs"
    folder = _job(root, 1, "train", ["--project", str(root)])
    for at in (".writer", "edits.db.lock", "settings.json", "together.captures"):
        (root / at).unlink(missing_ok=True)
        (root / at).symlink_to(bait.canary / "precious")
    for name in (".lock", "ran.txt"):
        (jobs / name).symlink_to(bait.canary / f"new{name}")
    for name in ("events.jsonl", "output.txt", "messages.txt", "wish", "worker.lock"):
        (folder / name).symlink_to(bait.canary / f"new-{name}")
    (root / "masks").symlink_to(bait.canary) if not (root / "masks").exists() else None


def linked_folders(root: Path, bait: Bait) -> None:
    shutil.rmtree(root / "logs", ignore_errors=True)
    (root / "logs").symlink_to(bait.canary)


def linked_database(root: Path, bait: Bait) -> None:
    (root / "edits.db").unlink(missing_ok=True)
    (root / "edits.db").symlink_to(bait.canary / "edits")
    (root / "project.db-journal").symlink_to(bait.canary / "precious")


def markup(root: Path, bait: Bait) -> None:
    text = MARKUP.format(bait.pipe)
    folder = _job(root, 1, "train", ["--project", str(root), text], text, state="failed", message=text)
    lines = [{"event": "failed", "stage": text, "message": text}, {"event": "log", "text": text, "stage": text},
             {"event": "preview", "stage": "train", "path": str(bait.pipe), "caption": text}]  # fmt: skip
    (folder / "events.jsonl").write_text("".join(json.dumps({"at": 1.0, **line}) + "\n" for line in lines))
    (folder / "messages.txt").write_text(text)
    _sql(root / "project.db", f"UPDATE viewpoints SET id = '{text}' WHERE seq = 0", "DELETE FROM edges",
         "DELETE FROM evidence", f"UPDATE viewpoints SET origin = '{text}'",
         f"INSERT INTO results VALUES ('{text}', 1e9, '{text}')")  # fmt: skip


def pipes(root: Path, bait: Bait) -> None:
    """Replaces every file that is read by a link to a pipe."""
    jobs = _job(root, 1, "train", ["--project", str(root)])
    for path in [*root.rglob("*.json"), *root.rglob("*.npz"), *root.rglob("*.png"), *root.rglob("*.yaml")]:
        path.unlink()
        path.symlink_to(bait.pipe)
    for name in ("settings.json", "views.json"):
        if not os.path.lexists(root / name):
            (root / name).symlink_to(bait.pipe)
    for name in ("events.jsonl", "output.txt", "messages.txt"):
        (jobs / name).symlink_to(bait.pipe)


def bombs(root: Path, bait: Bait) -> None:
    folder = _job(root, 1, "train", ["--project", str(root)], state="failed")
    with open(folder / "events.jsonl", "wb") as file:
        file.truncate(20 << 30)
    (root / "settings.json").write_text("[" * 1_000_000)
    (_job(root, 2, "map", []) / "order.json").write_text("[" * 500_000)
    header = b'{"shape":[100000,100000]}'
    blob = b"\x01" + len(header).to_bytes(4, "little") + header + zlib.compress(bytes(100 << 20))
    with contextlib.closing(sqlite3.connect(root / "project.db")) as connection:
        connection.execute("INSERT OR REPLACE INTO evidence VALUES (0, 'x', 0, ?)", (blob,))
        connection.commit()
    for number in range(10, 600):
        (root / "logs" / "jobs" / f"{number:06d}").mkdir()


TRAPS: dict[str, Trap] = {
    trap.__name__.replace("_", " "): trap
    for trap in (
        *(queued_jobs, foreign_process, smuggling_history, views, views_in_history, triggers, damaged_pages),
        *(empty_database, wrong_cells, links, linked_folders, linked_database, markup, pipes, bombs),
    )
}
