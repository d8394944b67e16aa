"""Commands that measure or write results of a project warn if its capture has changed since these were computed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.capture.store import save_capture
from nvsim.capture.types import Alignment, Capture, Frame
from nvsim.cli.command_table import COMMANDS
from nvsim.cli.console import redirect_events
from nvsim.cli.main import main
from nvsim.cli.options import command_of, options
from nvsim.events import Event, Warning
from nvsim.geometry.lens import Lens
from nvsim.project import ledger
from nvsim.project.project import Project
from nvsim.project.state.results import StageResult
from nvsim.project.work import STAGE, STAGES, WORK

NAMES = {"project", "projects", "graph", "a", "b", "also"}
"""Arguments that name a project, or a graph that can be that of a project."""
CHANGING = {"graph edit", "graph evidence", "graph log", "graph replay", "graph select"}
"""Commands that change a graph or find viewpoints to change."""


def reading_commands() -> dict[str, list[str]]:
    """The commands that measure or write results of a project, with their arguments; PROJECT is the project."""
    found = {}
    for verb in sorted(COMMANDS.keys() - CHANGING):
        rows = options(command_of(verb)) if verb.split()[0] in ("evaluate", "export", "graph") else []
        if any(row.path in NAMES for row in rows):
            words = [(row.flag, "PROJECT" if row.path in NAMES else "x") for row in rows if row.required]
            words += [(row.flag, "PROJECT") for row in rows if row.path == "project" and not row.required]
            found[verb] = [word for pair in words for word in pair if word]
    return found


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose capture was imported again after all stages."""
    folder = tmp_path_factory.mktemp("outdated")
    cv2.imwrite(str(folder / "0.png"), np.zeros((8, 8, 3), np.uint8))
    frame = Frame("0.png", folder / "0.png", Lens("PINHOLE", 8, 8, (8.0, 8.0, 4.0, 4.0)), np.eye(4))
    with Project.create_or_open(folder / "house.nvsim") as opened:
        save_capture(Capture(folder, "nerfstudio", (frame,), None, Alignment.identity()), opened.layout.imported)
        for stage in STAGES:
            ledger.begin_part(opened, stage, stage)
            ledger.finish(opened, stage, 0.0, {})
        found = opened.stage_results()
        imported = {0: replace(found.results["in use", "import"].parts[0], key="again")}
        opened.set_stage_results(found.with_result("in use", "import", StageResult(imported)))
        return opened.root


def warnings(verb: str, project: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The warnings of a command before it begins."""
    monkeypatch.setattr(command_of(verb), "run", lambda self: 0)
    heard: list[Event] = []
    words = [str(project) if word == "PROJECT" else word for word in reading_commands()[verb]]
    with redirect_events(heard.append):
        assert main([*verb.split(), *words]) == 0
    return [event.text for event in heard if isinstance(event, Warning)]


@pytest.mark.parametrize("verb", reading_commands())
def test_every_command_that_reads_results_warns_if_the_capture_has_changed(
    verb: str, project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (warned,) = warnings(verb, project, monkeypatch)
    assert "The capture has changed since" in warned
    last = WORK[verb].needs if verb in WORK else "map"
    assert last is not None
    for stage in STAGES[1:]:
        assert (f"`nvsim {STAGE[stage].command} --project`" in warned) == (STAGES.index(stage) <= STAGES.index(last))


def test_the_named_commands_are_among_them() -> None:
    named = {"export tasks", "export habitat", "export dataset", "export scan", "export r2r", "export graph"}
    named |= {f"evaluate {what}" for what in ("graph", "floor", "views", "normals", "depth", "calibration", "judge")}
    assert named | {"evaluate scan", "graph check"} <= reading_commands().keys()


def test_a_project_that_is_computed_from_its_capture_gets_no_warning(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Project.open(project, writable=True) as opened:
        before = opened.stage_results()
        for stage in STAGES[1:]:
            opened.set_stage_results(opened.stage_results().with_content(stage, "again"))
    try:
        assert not warnings("export tasks", project, monkeypatch)
    finally:
        with Project.open(project, writable=True) as opened:
            opened.set_stage_results(before)


def test_the_result_on_stdout_stays_complete(
    project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(self: object) -> int:
        print(json.dumps({"nodes": 3}))
        return 0

    monkeypatch.setattr(command_of("evaluate graph"), "run", run)
    assert main(["evaluate", "graph", "--project", str(project), "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out) == {"nodes": 3}
    assert "evaluate graph: warning: The capture has changed since" in output.err


def test_several_projects_are_named_in_their_warnings(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    link = tmp_path / "other.nvsim"
    link.symlink_to(project)
    monkeypatch.setattr(command_of("graph compare"), "run", lambda self: 0)
    assert main(["graph", "compare", str(project), str(link)]) == 0
    said = capsys.readouterr().err
    assert all(f"warning: {path}: The capture has changed since" in said for path in (project, link))
