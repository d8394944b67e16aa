"""The window finds an occupancy map that was built in a project, also while it is open."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import demo_project
import demo_room
import numpy as np
import pytest

from nvsim.capture.store import save_capture
from nvsim.capture.types import Cloud
from nvsim.cli.main import main
from nvsim.occupancy.read import read_map
from nvsim.occupancy.types import compare_maps
from nvsim.project.occupancy_maps import occupancy_of
from nvsim.project.project import Project
from nvsim_app.state.loading import Contents, ProjectReader
from nvsim_app.state.side_work import start_reading


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The demo project without its ground-truth map, and with a point cloud of its walls, furniture and floor."""
    folder = demo_project.write_project(tmp_path / "demo.nvsim", count=20_000, models=4)
    shutil.rmtree(folder / "ground_truth")
    x, y = np.meshgrid(np.arange(0.1, demo_room.WIDTH, 0.03), np.arange(0.1, demo_room.DEPTH, 0.03))
    walls, bare = demo_project.gaussians(200_000).means, ~demo_room.occupied(x, y)
    floor = np.stack([x[bare], y[bare], np.zeros(bare.sum())], axis=1).astype(np.float32)
    with Project.open(folder, writable=True) as opened:
        cloud = Cloud(np.concatenate([walls, floor]))
        save_capture(replace(demo_room.capture(), cloud=cloud), opened.layout.imported)
    return folder


def last(reader: ProjectReader) -> Contents | None:
    contents = None
    for contents in reader.updates():  # noqa: B007
        pass
    return contents


def test_a_window_that_is_open_shows_a_map_as_soon_as_it_is_built(project: Path) -> None:
    reader = ProjectReader(project)
    before = last(reader)
    assert before is not None and before.occupancy is None
    assert main(["occupancy", "build", "--project", str(project), "--resolution", "0.1"]) == 0
    after = last(reader)
    with Project.open(project) as opened:
        own = occupancy_of(opened)
    assert after is not None and after.occupancy is not None and own is not None
    assert np.array_equal(after.occupancy.cells, own.cells) and own.resolution == 0.1
    assert after.graph is before.graph
    reader.close()


def test_a_built_map_opens_by_itself(project: Path, tmp_path: Path) -> None:
    out = tmp_path / "map.yaml"
    assert main(["occupancy", "build", "--project", str(project), "--out", str(out)]) == 0
    found = start_reading(out).result()
    assert found is not None and np.array_equal(found.cells, read_map(out).cells)


def test_a_map_of_the_models_is_what_they_show_and_cannot_judge_them(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "trained.yaml"
    assert main(["occupancy", "build", "--project", str(project), "--source", "trained", "--out", str(out)]) == 0
    figures = compare_maps(read_map(out), demo_room.occupancy())
    assert figures["free_found_free"] > 0.6 and figures["occupied_found_free"] < 0.05, figures
    capsys.readouterr()
    assert main(["evaluate", "graph", "--project", str(project), "--occupancy", str(out)]) == 2
    assert "own models" in capsys.readouterr().err
