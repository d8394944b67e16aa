"""No command prints a control character from a file to a terminal."""

from __future__ import annotations

import ast
import io
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from capture_samples import room, walk, write_nerfstudio

from nvsim.cli import terminal
from nvsim.cli.console import event_listener
from nvsim.cli.main import COMMANDS, main
from nvsim.cli.terminal import guarded_stream, guarded_terminal, print_lines
from nvsim.events import Done, Failed, Log, Progress, Warning
from nvsim.plain_text import UNSEEN, printable

EVIL = "\x1b]0;PWN\x07\x1b[31mRED\u202e\x9b31m\r\b\x7f[/red]"
FORGED = "\nAll is well."
SOURCES = Path(__file__).parents[2] / "nvsim"


def unseen(text: str) -> list[str]:
    return [c for c in UNSEEN.findall(text) if c not in "\n\t"]


def connectivity(folder: Path, scan: str, ids: list[str]) -> Path:
    """A corridor of viewpoints 2 m apart."""
    rows = [
        {
            "image_id": id,
            "pose": [1, 0, 0, 2.0 * i, 0, 1, 0, 0.5 * i, 0, 0, 1, 1.5, 0, 0, 0, 1],
            "included": True,
            "visible": [i != j for j in range(len(ids))],
            "unobstructed": [abs(i - j) == 1 for j in range(len(ids))],
            "height": 1.5,
        }
        for i, id in enumerate(ids)
    ]
    path = folder / f"{scan}_connectivity.json"
    path.write_text(json.dumps(rows))
    return path


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A graph, tasks, trajectories, a capture and folders, all of them with control characters in their names."""
    folder = tmp_path_factory.mktemp("hostile")
    ids = [f"v{i}" + (EVIL + FORGED if i in (2, 3) else "") for i in range(6)]
    connectivity(folder, "s", ids)
    scans = folder / "scans"
    scans.mkdir()
    connectivity(scans, "x\x1b[31m", ids)
    (scans / "scans.txt").write_text("x\x1b[31m\n")
    red = folder / "dir\x1b[31mred\nforged"
    red.mkdir()
    connectivity(red, "s", ids)
    task = {"distance": 6.2, "scan": "s", "path_id": 4, "path": ids[:4], "heading": 1.5}
    (folder / "R2R_val_unseen.json").write_text(json.dumps([{**task, "instructions": ["go " + EVIL, "walk"]}]))
    (folder / "a.json").write_text(json.dumps([{"instr_id": "4_0" + EVIL, "trajectory": [["v0", 0, 0]]}]))
    walked = [["v0", 0, 0], ["v1", 0, 0], ["v5" + EVIL, 0, 0]]
    (folder / "b.json").write_text(json.dumps([{"instr_id": f"4_{k}", "trajectory": walked} for k in range(2)]))
    capture = folder / "capture"
    write_nerfstudio(capture, walk(), room())
    (transforms,) = capture.rglob("transforms.json")
    tree = json.loads(transforms.read_text())
    for k, frame in enumerate(tree["frames"]):
        if k % 3 == 0:
            old = capture / frame["file_path"]
            frame["file_path"] = str(Path(frame["file_path"]).with_name(f"a{k}\x1b[31m\x9b\n.png"))
            old.rename(capture / frame["file_path"])
    tree["frames"][5]["file_path"] = "images/gone\x1b]0;PWN\x07.png"
    transforms.write_text(json.dumps(tree))
    return folder


GRAPH = "s_connectivity.json"
CASES: list[list[str]] = [
    ["graph", "check", GRAPH],
    ["graph", "check", GRAPH, "--json"],
    ["graph", "check", "scans"],
    ["graph", "check", "dir\x1b[31mred\nforged"],
    ["graph", "check", "nope\x1b[31mred\nforged"],
    ["graph", "select", GRAPH, "degree > 0"],
    ["graph", "select", GRAPH, "degree > \x1b[31m"],
    ["graph", "review", GRAPH],
    ["graph", "propose", GRAPH],
    ["graph", "compare", GRAPH, "scans"],
    ["graph", "log", GRAPH],
    ["graph", "edit", GRAPH, "remove_edges", "--where", "length > 0", "--out", "e_connectivity.json"],
    ["graph", "edit", GRAPH, "remove_viewpoints", "--where", "degree > 0", "--dry-run"],
    ["graph", "edit", GRAPH, "remove_\x1b[31m"],
    ["graph", "\x1b[31m"],
    ["\x1b[31m"],
    ["graph", "check", "--\x1b[31m"],
    ["check", "capture"],
    ["check", "capture", "--json"],
    ["import", "capture", "--project", "c.nvsim"],
    ["evaluate", "r2r", "--scans", ".", "--tasks", "R2R_val_unseen.json", "--agents", "shortest"],
    ["evaluate", "r2r", "--scans", ".", "--tasks", "R2R_val_unseen.json", "--submission", "a.json"],
    ["evaluate", "r2r", "--scans", ".", "--tasks", "R2R_val_unseen.json", "--submission", "b.json"],
    ["evaluate", "scan", "scans"],
    ["export", "graph", GRAPH, "--format", "svg", "--out", "g"],
    ["export", "tasks", "--scans", "scans", "--out", "tasks"],
    ["export", "candidates", "scans", "--out", "candidates"],
    ["app", "nope\x1b[31mred"],
]


@pytest.mark.parametrize("argv", CASES, ids=lambda argv: ascii(" ".join(argv[:4])))
def test_no_command_prints_control_characters(
    hostile: Path, argv: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(hostile)
    try:
        code = main(argv)
    except SystemExit as stop:
        code = int(stop.code or 0)
    said = capsys.readouterr()
    assert said.out + said.err
    assert not unseen(said.out + said.err)
    assert code in (0, 1, 2) and "a bug in NVSim" not in said.err
    lines = (said.out + said.err).split("\n")
    assert "All is well." not in lines and "forged" not in lines  # a name makes no line of its own
    if "--json" in argv:
        json.loads(said.out)


def test_commands_print_through_say_alone() -> None:
    """A bare print would let a line break in a name pass. Tables, whose cells are made printable, end in one."""
    for path in [*SOURCES.glob("cli/**/*.py")]:
        if path.name == "terminal.py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print":
                assert any(k.arg == "end" for k in node.keywords), f"{path.name}:{node.lineno} prints by itself"
    assert COMMANDS


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_progress_display_shows_foreign_text_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm-256color")
    with guarded_terminal(), event_listener(False) as listen:
        listen(Progress("train", 1, 10, f"[link=http://evil]{EVIL}"))
        for event in (Done, Warning, Log, Failed):
            listen(event(stage="s[/]", **{name_of(event): f"[bold]{EVIL}{FORGED}"}))
        print(EVIL, file=sys.stderr)  # of a library, while the bars are shown
    shown = screen.getvalue()
    assert shown.count("[bold]\\x1b]0;PWN\\x07\\x1b[31mRED‹U+202E›") == 4
    own = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]|\r", "", shown)  # of the display itself
    assert not unseen(own) and "[link=http://evil]" in own
    assert "\x1b[31m" not in shown.replace("\x1b[31m✗", "")


def name_of(event: Any) -> str:
    return {Done: "summary", Failed: "message"}.get(event, "text")


def test_a_table_shows_brackets_and_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    terminal.table(("a", "b"), [("[/b]", f"x{EVIL}"), (":smile:", "[link=file:///etc]y[/link]")], "[title]\x1b[31m")
    shown = capsys.readouterr().out
    assert not unseen(shown) and "[/b]" in shown and ":smile:" in shown and "[title]\\x1b[31m" in shown


def test_text_of_any_origin_is_guarded() -> None:
    behind = io.StringIO()
    stream = guarded_stream(behind)  # type: ignore[arg-type]
    stream.writelines(["one\x1b[2J\ttwo\n", "three\u2066\n"])
    assert behind.getvalue() == "one\\x1b[2J\ttwo\nthree‹U+2066›\n"


def test_say_prints_each_text_as_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_lines("one\ntwo", Path("a\u2028b"))
    assert capsys.readouterr().out == "one\\ntwo\na‹U+2028›b\n"


def test_letters_of_all_scripts_stay() -> None:
    for text in ("Büro Küche", "廊下", "ممر", "מסדרון", "коридор", "👩‍💻", "नमस्ते", "a b"):
        assert printable(text) == text
    assert printable("a\udce9b") == "a\\udce9b"


def test_json_stays_json_whatever_it_holds(capsys: pytest.CaptureFixture[str]) -> None:
    print_lines(terminal.as_json({"name": EVIL + FORGED}))
    assert json.loads(capsys.readouterr().out) == {"name": EVIL + FORGED}


def test_a_traceback_in_a_log_is_readable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import tempfile

    from nvsim.cli.commands.graph_edit import GraphLog
    from nvsim.cli.guard import run_guarded

    def crash(_: object) -> int:
        raise RuntimeError(EVIL)

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(GraphLog, "run", crash)
    assert run_guarded("graph log", GraphLog, ["x"]) == 1
    (log,) = tmp_path.glob("*.log")
    assert not unseen(log.read_text()) and "RuntimeError: \\x1b]0;PWN" in log.read_text()
