"""The table of validities on two rooms with few steps: killed, gone on with, and built in another order."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from nvsim.building import BuildingConfig, generate
from nvsim.errors import InputError
from nvsim.evaluation.ablation_runs import Budget, preset_rows, training_run
from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.truth import true_occupancy
from nvsim.evaluation.validity import TableConfig, build_stored_map, evaluate_validity, stored_map_of, with_criteria
from nvsim.events import ignore_event
from nvsim.graph.store import same_graph
from nvsim.mapping.config import MappingConfig
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, submaps
from nvsim.submaps.split import SubmapConfig

STEPS, SIZE, CAP = 100, 160, 3000
BUDGET = Budget(STEPS, SIZE, CAP)
PRESETS = ("3dgs", "nvsim")
COLUMNS = (("alpha", "normal"), ("normal",), ("alpha",))


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rooms with floor masks, nothing trained."""
    root = tmp_path_factory.mktemp("validity") / "rooms.nvsim"
    with Project.create_or_open(root) as project:
        generate(root, BuildingConfig(size="small", width=200, height=150, step=0.6, turn=24.0, people=False))
        imported.run(project, project.layout.built_in_capture, CaptureConfig(), ignore_event)
        submaps.run(project, SubmapConfig(), ignore_event)
        floors.run(project, ignore_event)
    return root


def command(project: Path) -> list[str]:
    return [sys.executable, "-m", "nvsim", "evaluate", "validity-table", "--project", str(project), "--json",
            "--steps", str(STEPS), "--image-size", str(SIZE), "--gaussian-cap", str(CAP),
            "--presets", *PRESETS, "--columns", *("+".join(c) for c in COLUMNS), "alpha+nonsense"]  # fmt: skip


def made_when(project: Path) -> dict[str, int]:
    return {p.parent.name: p.stat().st_mtime_ns for p in project.glob("validity/*/cell.json")}


@pytest.fixture(scope="module")
def made(rooms: Path) -> dict:
    """The results of a process that goes on where another was killed, after its first map."""
    process = subprocess.Popen(command(rooms), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        event = json.loads(line)
        if event["event"] == "log" and "map of nvsim" in event["text"]:
            process.send_signal(signal.SIGKILL)
            break
    process.stdout.close()
    assert process.wait() == -signal.SIGKILL
    survived = made_when(rooms)
    assert len(survived) >= len(COLUMNS), "those of the first model"
    again = subprocess.run(command(rooms), capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert survived.items() <= made_when(rooms).items(), "finished maps are not built again"
    (done,) = [e for e in map(json.loads, again.stdout.splitlines()) if e["event"] == "done"]
    assert done["results"]["reused"] == len(survived) and done["results"]["trained"] == 0
    return done["results"]


def test_every_cell_is_the_figures_of_its_kept_map(rooms: Path, made: dict) -> None:
    cells = {(c["model"], c["criteria"]): c for c in made["cells"]}
    assert set(cells) == {(m, "+".join(c)) for m in PRESETS for c in COLUMNS}
    assert "alpha & nonsense" in made["left_out"]
    with Project.open(rooms) as project:
        occupancy, walk = true_occupancy(project, None, "aligned"), project.need_capture().positions[:, :2]
        for row in preset_rows(BUDGET, PRESETS):
            runs = [training_run(project, s, row.config, 0) for s in project.need_submaps()]
            for criteria in COLUMNS:
                mapping = with_criteria(MappingConfig(), criteria)
                assert mapping is not None
                graph, report = stored_map_of(project, runs, mapping).read()
                cell = cells[row.name, "+".join(criteria)]
                if graph is None:
                    assert cell["why"] == report["why"] and "nodes" not in cell
                    continue
                figures = evaluate_graph(graph, occupancy, walk)
                assert figures.items() <= cell.items()
        assert project.graph() is None and not project.layout.models.exists(), "the project's own stay as they are"
    ours = cells["nvsim", "alpha+normal"]
    assert ours["nodes"] >= 3 and ours["edge_validity"] == 1 and ours["coverage_seen"] > 0.5


def test_files_are_there(made: dict) -> None:
    files = {Path(f).name: Path(f) for f in made["files"]}
    with open(files["validity.csv"], newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["model"], r["why"]) for r in rows] == [(c["model"], c["why"]) for c in made["cells"]]
    assert files["nvsim_alpha-normal.png"].stat().st_size > 1000 and "toprule" in files["validity.tex"].read_text()


def test_a_map_is_the_same_whether_other_columns_were_built_before_it(rooms: Path, made: dict) -> None:
    with Project.open(rooms, writable=True) as project:
        (row,) = preset_rows(BUDGET, ("nvsim",))
        runs = [training_run(project, s, row.config, 0) for s in project.need_submaps()]
        mapping = with_criteria(MappingConfig(), COLUMNS[-1])
        assert mapping is not None
        kept = stored_map_of(project, runs, mapping)
        before, _ = kept.read()
        shutil.rmtree(kept.folder)
        build_stored_map(project, runs, mapping, kept, [], ignore_event)
        after, _ = kept.read()
        assert before is not None and after is not None and same_graph(before, after)


def test_a_second_call_makes_nothing(rooms: Path, made: dict) -> None:
    before = made_when(rooms)
    with Project.open(rooms, writable=True) as project:
        occupancy = true_occupancy(project, None, "aligned")
        config = TableConfig(PRESETS, COLUMNS, BUDGET)
        table = evaluate_validity(project, config, occupancy, ignore_event)
        assert (table.trained, table.built, table.reused) == (0, 0, len(PRESETS) * len(COLUMNS))
        with pytest.raises(InputError, match="Skipped: nonsense"):
            evaluate_validity(project, TableConfig(PRESETS, (("nonsense",),), BUDGET), occupancy, ignore_event)
    assert made_when(rooms).items() >= before.items()
