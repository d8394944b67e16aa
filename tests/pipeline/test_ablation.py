"""The ablation on two rooms with few steps: every row, every file, and nothing trained twice."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.building import BuildingConfig, generate
from nvsim.evaluation import ablation_runs
from nvsim.evaluation.ablation import AblationConfig, evaluate_ablation
from nvsim.evaluation.ablation_runs import ROWS, Budget, training_run
from nvsim.events import Event, Log, Progress, ignore_event
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, submaps
from nvsim.splats.files import load_model
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import PRESETS, preset

STEPS, SIZE, CAP = 100, 160, 3000
BUDGET = Budget(STEPS, SIZE, CAP)


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rooms with floor masks, nothing trained."""
    root = tmp_path_factory.mktemp("ablation") / "rooms.nvsim"
    with Project.create_or_open(root) as project:
        generate(root, BuildingConfig(size="small", width=200, height=150, step=0.6, turn=24.0, people=False))
        imported.run(project, project.layout.built_in_capture, CaptureConfig(), ignore_event)
        submaps.run(project, SubmapConfig(), ignore_event)
        floors.run(project, ignore_event)
    return root


def command(project: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "nvsim", "evaluate", "ablation", "--project", str(project), "--json",
            "--steps", str(STEPS), "--image-size", str(SIZE), "--gaussian-cap", str(CAP), *more]  # fmt: skip


def results(output: str) -> dict:
    (done,) = [e for e in map(json.loads, output.splitlines()) if e["event"] == "done"]
    return done["results"]


def runs(project: Path) -> dict[str, int]:
    return {p.parent.name: p.stat().st_mtime_ns for p in project.glob("ablation/*/model")}


@pytest.fixture(scope="module")
def made(rooms: Path) -> tuple[dict, dict]:
    """The results of both tables, made by a process that is killed after its first run and by one that is not."""
    process = subprocess.Popen(command(rooms), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        event = json.loads(line)
        if event["event"] == "progress" and event["done"] > STEPS:
            process.send_signal(signal.SIGKILL)
            break
    process.stdout.close()
    assert process.wait() == -signal.SIGKILL
    survived = runs(rooms)
    assert len(survived) >= 1
    again = subprocess.run(command(rooms, "--resume"), capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert survived.items() <= runs(rooms).items(), "finished runs are not trained again"
    return survived, results(again.stdout)


def test_every_row_of_both_tables_is_there_and_shared_runs_are_trained_once(
    rooms: Path, made: tuple[dict, dict]
) -> None:
    survived, found = made
    tables = {name: {row["row"]: row for row in rows} for name, rows in found["tables"].items()}
    assert tuple(tables["ablation"]) == ROWS and set(tables["presets"]) == set(PRESETS)
    assert found["trained"] + found["reused"] == len(runs(rooms)) < len(ROWS) + len(PRESETS)
    assert found["reused"] == len(survived)
    ours, shared = dict(tables["ablation"]["ours"]), dict(tables["presets"]["splatfacto-i"])
    assert {**ours, "row": "", "title": ""} == {**shared, "row": "", "title": ""}
    for rows in tables.values():
        for row in rows.values():
            assert row["psnr"] > 12 and row["frames"] >= 5 and row["gaussians"] <= CAP and row["novel_psnr"] > 8


def test_floor_suppression_empties_the_floor_and_the_background_floor_loss_paints_it(made: tuple[dict, dict]) -> None:
    rows = {row["row"]: row for row in made[1]["tables"]["ablation"]}
    assert rows["suppression"]["alpha_floor"] < 0.5 * rows["masking"]["alpha_floor"]
    assert rows["suppression"]["alpha_nonfloor"] > 3 * rows["suppression"]["alpha_floor"]
    assert rows["floor"]["psnr_floor"] > rows["suppression"]["psnr_floor"] + 0.5


def test_files_are_there_and_the_pictures_show_something(rooms: Path, made: tuple[dict, dict]) -> None:
    files = {Path(f).name: Path(f) for f in made[1]["files"]}
    assert set(files) == {"tables.txt", "ablation.csv", "ablation.png", "presets.csv", "presets.png"}
    with open(files["ablation.csv"], newline="") as file:
        rows = list(csv.DictReader(file))
    means = [r for r in rows if r["submap"] == "mean"]
    assert [r["row"] for r in means] == list(ROWS)
    assert float(means[0]["psnr"]) == made[1]["tables"]["ablation"][0]["psnr"]
    for name in ("ablation.png", "presets.png"):
        sheet = cv2.imread(str(files[name]))
        tiles = sheet[100:200, 16:].astype(float)
        assert tiles.std() > 20 and np.abs(np.diff(tiles, axis=1)).mean() > 1
    text = files["tables.txt"].read_text()
    assert all(row["title"] in text for row in made[1]["tables"]["ablation"]) and "LPIPS is empty" in text


def test_a_second_call_trains_nothing_and_leaves_the_project_s_models_alone(
    rooms: Path, made: tuple[dict, dict]
) -> None:
    before = runs(rooms)
    with Project.open(rooms, writable=True) as project:
        outcome = evaluate_ablation(project, AblationConfig(budget=BUDGET), ignore_event)
        assert not project.layout.models.exists()
    assert (outcome.trained, runs(rooms)) == (0, before)
    assert outcome.tables["ablation"].rows == made[1]["tables"]["ablation"]


def test_judges_compare_the_models_of_the_ablation_and_train_nothing(rooms: Path, made: tuple[dict, dict]) -> None:
    before = runs(rooms)
    options = ["--presets", "3dgs", "splatfacto-i", "--seen", "2", "--novel", "3", "--image-width", "100"]
    judge = [word if word != "ablation" else "judge" for word in command(rooms, *options)]
    done = subprocess.run(judge, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = results(done.stdout)
    assert runs(rooms) == before
    rows = [row for row in found["rows"] if not row["why"]]
    assert [row["judge"] for row in rows] == ["sharpness (offline, no reference)"]
    assert {rows[0]["a"], rows[0]["b"]} == {"3dgs", "splatfacto-i"} and rows[0]["novel_pairs"] > 0
    images = sorted((rooms / "judge" / "images").rglob("*.png"))
    assert len(images) == 2 * rows[0]["pairs"]
    for path in images:
        assert cv2.imread(str(path)).shape == (75, 100, 3)
    stamps = {path: path.stat().st_mtime_ns for path in images}
    assert subprocess.run(judge, capture_output=True, check=False).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in images} == stamps, "images are drawn once"


class Killed(BaseException):
    pass


def test_a_run_that_is_cut_off_goes_on_from_its_checkpoint_and_ends_with_the_same_model(
    rooms: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    budget = Budget(40, SIZE, CAP)
    monkeypatch.setattr(ablation_runs, "preset", lambda name: replace(preset(name), checkpoint_seconds=0.0))
    monkeypatch.setattr("nvsim.training.trainer.REPORT_SECONDS", 0.0)
    config = AblationConfig(("ablation",), ("ours",), budget=budget)
    (row,) = ablation_runs.ablation_rows(budget, ["ours"])
    seen: list[Event] = []

    def kill(event: Event) -> None:
        seen.append(event)
        if isinstance(event, Progress) and event.done == budget.steps // 2:
            raise Killed

    with Project.open(rooms, writable=True) as project:
        run = training_run(project, project.need_submaps()[0], row.config, 0)
        # Kernels that a process has just compiled round differently from those it reads from the cache, so that the
        # run to compare with is made here as well.
        evaluate_ablation(project, replace(config, repeat=True), ignore_event)
        whole = load_model(run.model_folder).gaussians.means
        with pytest.raises(Killed):
            evaluate_ablation(project, replace(config, repeat=True), kill)
        assert run.checkpoint.is_file() and not run.is_done
        resumed = evaluate_ablation(project, config, seen.append)
    assert any(isinstance(e, Log) and "continues from step" in e.text for e in seen)
    assert resumed.trained == 1 and not run.checkpoint.exists()
    np.testing.assert_array_equal(load_model(run.model_folder).gaussians.means, whole)
