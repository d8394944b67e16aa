"""A benchmark by one command: it is whole, goes on where it was, and keeps its hands off what is not its own."""

from __future__ import annotations

import json
import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from scan_samples import scan_project

from nvsim.cli.main import main
from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.piece import WorkItem
from nvsim.errors import InputError
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.project.project import Project
from nvsim.r2r.observations.stub import write_stub_graph

FEW = ["--fewest-edges", "2", "--least-meters", "2", "--train", "4", "--val-seen", "1", "--val-unseen", "0"]
SMALL = ["--size", "64", "--projection", *FEW]


def row() -> NavGraph:
    """Six viewpoints in a row through the hall."""
    ids = [f"{i:032x}" for i in range(1, 7)]
    viewpoints = {id: Viewpoint(id, (1.6 + 1.7 * i, 3.0 + 0.1 * (i % 2), 1.5)) for i, id in enumerate(ids)}
    return NavGraph("hall", viewpoints, {e.key: e for e in (edge(a, b) for a, b in zip(ids, ids[1:]))})


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = scan_project(tmp_path_factory.mktemp("project"))
    with Project.open(root, writable=True) as opened:
        opened.set_graph(row())
    return root


def files(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_one_command_makes_a_benchmark_and_goes_on_where_it_was(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = tmp_path / "whole"
    command = ["export", "dataset", "--project", str(project), *SMALL, "--out", str(whole)]

    # Cut off after the scan: what was drawn stays, and no card says that it is whole.
    class Cut(BaseException):
        pass

    from nvsim.dataset import building

    def off(*_: object) -> None:
        raise Cut

    with monkeypatch.context() as patch:
        patch.setattr(building, "_features", off)
        with pytest.raises(Cut):
            main(command)
    assert not json.loads((whole / "dataset.json").read_text())["finished"] and not (whole / "README.md").exists()
    drawn = {path: path.stat().st_mtime_ns for path in whole.rglob("*_skybox_small.jpg")}
    assert len(drawn) == 7  # the stub's too
    assert main(command) == 0
    assert {path: path.stat().st_mtime_ns for path in drawn} == drawn

    said = capsys.readouterr().out
    assert "SHORTEST" in said and "RANDOM-PAPER" in said and "a follower finds" in said
    about = json.loads((whole / "dataset.json").read_text())
    assert about["finished"] and about["scans"] == {"hall": {"viewpoints": 6, "edges": 5}}
    train = about["baselines"]["train"]
    assert train["SHORTEST"]["success"] == 1.0 and train["SHORTEST"]["ne"] == 0.0
    assert train["RANDOM"]["instructions"] == 3 * about["tasks"]["paths"]["train"] == 12
    card = (whole / "README.md").read_text()
    assert "| words per instruction |" in card and "Their register is `short`" in card
    assert "| hall | 6 | 5 |" in card and "SHORTEST" in card and "R2R_SPLIT.json" in card
    (repeat,) = re.findall("To repeat: `nvsim (.*)`", card)
    assert repeat.split()[:2] == ["evaluate", "r2r"] and "R2R_val_seen.json --agents shortest random random-" in repeat
    monkeypatch.chdir(whole)  # the command of the card runs in its folder, although val_unseen is empty
    assert main(repeat.split()) == 0 and "RANDOM-PAPER" in capsys.readouterr().out
    file_line = card[card.index("- `features/`") :].splitlines()[1]
    assert file_line.startswith("  - `features/pth_vit_base_patch16_224_imagenet.hdf5`: by random projection")
    for name in ("scans/hall/manifest.json", "tasks/R2R_train.json", "tasks/surroundings.json",
                 "features/pth_vit_base_patch16_224_imagenet.hdf5", "results/random_train.json"):  # fmt: skip
        assert (whole / name).is_file(), name
    tables = yaml.safe_load(card.split("---\n")[1])["configs"]
    assert [(one["config_name"], [file["split"] for file in one["data_files"]]) for one in tables] == [
        ("instructions", ["train", "val_seen"]), ("viewpoints", ["viewpoints"])
    ]  # fmt: skip
    rows = {name: [json.loads(line) for line in (whole / "data" / name).read_text().splitlines()]
            for name in (Path(file["path"]).name for one in tables for file in one["data_files"])}  # fmt: skip
    tasks = json.loads((whole / "tasks/R2R_train.json").read_text())
    found = [(one["path_id"], one["instruction"], one["path"]) for one in rows["instructions_train.jsonl"]]
    assert found == [(task["path_id"], text, task["path"]) for task in tasks for text in task["instructions"]]
    assert [len(one["neighbors"]) for one in rows["viewpoints.jsonl"]] == [1, 2, 2, 2, 2, 1]
    assert all((whole / one[kind]).is_file() for one in rows["viewpoints.jsonl"] for kind in ("skybox", "depth"))
    before, features = files(whole), next((whole / "features").glob("*.hdf5"))
    made = features.stat().st_mtime_ns
    assert main(command) == 0 and files(whole).keys() == before.keys()
    assert [name for name, data in files(whole).items() if data != before[name]] == []
    assert features.stat().st_mtime_ns == made


def test_it_is_foretold_and_nothing_is_written(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["export", "dataset", "--project", str(project), "--out", str(out), *SMALL, "--dry-run"]
    command += ["--vlnce", "--rxr", "--goals"]
    assert main([*command, "--json"]) == 0 and not out.exists()
    found = json.loads(capsys.readouterr().out)
    assert found["scans"] == ["hall"] and found["drawn"] == found["todo"] == 6 and found["paths"]["train"] == 4
    kinds = {kind["what"]: kind for kind in found["kinds"]}
    assert kinds["features"]["bytes"] == 6 * 36 * 4 * 1768
    assert {"tasks", "episodes", "RxR", "goals", "baselines"} <= kinds.keys()
    assert main(command) == 0 and "takes" in capsys.readouterr().out


def test_nothing_is_drawn_if_no_path_fits(project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["export", "dataset", "--project", str(project), *SMALL[:-2], "--val-unseen", "9", "--out"]
    assert main([*command, str(tmp_path / "out")]) == 2
    assert "No region contains a path" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_what_is_not_its_own_stays(project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "README.md").write_text("my thesis")
    command = ["export", "dataset", "--project", str(project), *SMALL, "--out"]
    assert main([*command, str(tmp_path / "mine")]) == 2
    assert "contains files that are not" in capsys.readouterr().err
    assert files(tmp_path / "mine") == {"README.md": b"my thesis"}
    assert main([*command, str(tmp_path / "twice"), "--also", str(project)]) == 2
    assert "Two projects" in capsys.readouterr().err and not (tmp_path / "twice").exists()


def test_a_cluster_draws_the_images(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Cluster:
        remote, storage, machines = True, "shared", (2, 2)

        def run(self, pieces: list[WorkItem], begin: object) -> Generator[tuple[WorkItem, object], None, None]:
            yield from ()
            raise InputError(f"asked for {sum(int(piece.label.split()[0]) for piece in pieces)} viewpoints")

    @contextmanager
    def opened(config: ClusterConfig) -> Iterator[Cluster]:
        assert config == ClusterConfig("ray", "head:6379")
        yield Cluster()

    monkeypatch.setattr("nvsim.cli.commands.export_dataset.open_executor", opened)
    command = ["export", "dataset", "--project", str(project), *SMALL, "--out", str(tmp_path / "out")]
    assert main([*command, "--executor", "ray", "--address", "head:6379"]) == 2
    assert "asked for 6 viewpoints" in capsys.readouterr().err


def test_a_job_may_only_name_places_that_its_user_chose(project: Path, tmp_path: Path) -> None:
    from nvsim.cli.worker import check_order
    from nvsim.project.jobs.joblist import JobCommand

    words = ["--project", str(project), "--out", str(project / "set"), "--also", str(tmp_path / "other.nvsim")]
    check_order(project, JobCommand("export dataset", tuple(words), "Dataset"))
    with pytest.raises(InputError, match="also"):
        check_order(project, JobCommand("export dataset", tuple(words), "Dataset"), confined=True)


def test_tasks_of_a_scan_with_another_id_than_its_project_name_the_option(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_connectivity(replace(row(), scan="demo"), tmp_path / "scans" / "connectivity")
    write_stub_graph(tmp_path / "scans" / "connectivity")
    command = ["export", "tasks", "--scans", str(tmp_path / "scans"), "--project", str(project), *FEW]
    command += ["--out", str(tmp_path / "tasks")]
    assert main(command) == 2 and "with --only: demo." in capsys.readouterr().err
    assert main([*command, "--only", "demo"]) == 0 and (tmp_path / "tasks" / "R2R_train.json").exists()


def test_a_dataset_without_instructions_names_no_follower(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", "dataset", "--project", str(project), *SMALL, "--out", str(tmp_path / "out")]
    assert main([*command, "--instructions", "0", "--features", "vit-b16", "--seed", "3"]) == 0
    card, said = (tmp_path / "out" / "README.md").read_text(), capsys.readouterr().out
    assert "The paths have no instructions." in card and "follower finds" not in card + said
    assert "--agents shortest random random-paper --seed 3`" in card
