"""A splat file becomes a project: import, floors, and map without images; other stages and bad files are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from nvsim.cli.main import main
from nvsim.graph.paths import components
from nvsim.project.project import Project
from nvsim.splats.formats.choice import read_splats, write_splats
from nvsim_app.state.loading import ProjectReader
from nvsim_app.state.reasons import reason_of_command
from tests.unit.splat_rooms import any_rotation, moved, rectangle, stair_house, two_rooms

SCALE = 1.7


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("splats")
    write_splats(folder / "room.ply", moved(two_rooms(), any_rotation(3), SCALE), False, "ply")
    arguments = ["run", str(folder / "room.ply"), "--project", str(folder / "room.nvsim"), "--scale", str(1 / SCALE)]
    assert main(arguments) == 0
    return folder / "room.nvsim"


def test_the_project_has_the_stages_of_splats_alone(project: Path) -> None:
    with Project.open(project) as opened:
        assert opened.stage_results().finished_stages == {"import", "floors", "map"}
        capture = opened.need_capture()
        assert capture.frames == () and not capture.has_images and len(capture.positions) > 10
        assert not opened.layout.masks.exists() and opened.scene() is not None


def test_the_graph_joins_both_rooms_and_avoids_furniture(project: Path) -> None:
    with Project.open(project) as opened:
        graph, capture = opened.need_graph(), opened.need_capture()
    back = any_rotation(3).T @ capture.alignment.rotation.T  # to the frame of the synthetic rooms
    places = {id: back @ v.position for id, v in graph.viewpoints.items()}
    assert len(components(graph)) == 1 and len(places) >= 8
    assert {x < 4 for x, _, _ in places.values()} == {True, False}
    for x, y, z in places.values():
        assert 0.25 < x < 7.85 and 0.25 < y < 4.75 and z == pytest.approx(1.5, abs=0.03)
    for a, b in graph.edges:
        line = places[a] + np.linspace(0, 1, 60)[:, None] * (places[b] - places[a])
        assert not ((line[:, 0] > 0.9) & (line[:, 0] < 2.3) & (line[:, 1] > 2.9) & (line[:, 1] < 3.9)).any()
        through = line[np.abs(line[:, 0] - 4.05) < 0.1]
        assert ((through[:, 1] > 2.2) & (through[:, 1] < 2.8)).all()  # only through the doorway


def test_floor_under_furniture_and_walls_is_not_known_floor(project: Path) -> None:
    with Project.open(project) as opened:
        support, alignment = opened.support(), opened.need_capture().alignment
    assert support is not None
    places = np.array([[1.6, 3.4, 0.0], [4.0, 1.0, 0.0], [7.2, 1.2, 0.0], [4.05, 2.5, 0.0], [3.0, 1.5, 0.0]])
    known = support.is_supported(places @ (alignment.rotation @ any_rotation(3)).T)
    assert known.tolist() == [False, False, False, True, True]  # table, wall, bed; doorway, floor


def test_viewpoints_on_a_stair_and_around_a_corner_are_joined(tmp_path: Path) -> None:
    write_splats(tmp_path / "house.ply", stair_house(), False, "ply")
    house = tmp_path / "house.nvsim"
    assert main(["run", str(tmp_path / "house.ply"), "--project", str(house), "--scale", "1"]) == 0
    with Project.open(house) as opened:
        graph = opened.need_graph()
    heights = {id: v.position[2] for id, v in graph.viewpoints.items()}
    assert any(abs(z - 1.5) < 0.05 for z in heights.values()) and any(abs(z - 4.5) < 0.05 for z in heights.values())
    assert max(abs(heights[a] - heights[b]) for a, b in graph.edges) > 1.0
    # A viewpoint beside the bed joins the rest of its room with the foot of the stair.
    lower_room = [id for id, v in graph.viewpoints.items() if v.position[0] > 5.5 and heights[id] < 2]
    assert any({*lower_room} <= {*part} for part in components(graph))


def test_a_second_run_finds_everything_up_to_date(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = str(project.with_name("room.ply"))
    assert main(["run", source, "--project", str(project), "--scale", str(1 / SCALE)]) == 0
    said = "".join(capsys.readouterr())
    assert "The capture is unchanged." in said and "The navigation graph is up to date." in said


@pytest.mark.parametrize("verb", ["submaps", "depth", "train"])
def test_a_stage_that_needs_images_says_so(project: Path, verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([verb, "--project", str(project)]) == 2
    assert "no images" in capsys.readouterr().err


def test_the_splats_can_be_exported_in_their_own_frame(project: Path, tmp_path: Path) -> None:
    assert main(["export", "splats", "--project", str(project), "--out", str(tmp_path), "--frame", "capture"]) == 0
    exported = read_splats(tmp_path / "submap_000.ply").gaussians
    source = read_splats(project.with_name("room.ply")).gaussians
    np.testing.assert_allclose(exported.means, source.means, atol=1e-4)


def test_the_window_offers_only_what_applies(project: Path) -> None:
    reader = ProjectReader(project)
    try:
        contents = None
        for contents in reader.updates():  # noqa: B007
            pass
        assert contents is not None and contents.missing == "" and not contents.has_images
        document = type("Opened", (), {"contents": contents})()
        for verb in ("submaps", "depth", "train", "evaluate views"):
            assert "no images" in str(reason_of_command(verb)(document))
    finally:
        reader.close()


def test_a_refused_file_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_splats(tmp_path / "floor.ply", rectangle((0, 0, 0), (6, 0, 0), (0, 6, 0)), False, "ply")
    assert main(["import", str(tmp_path / "floor.ply"), "--project", str(tmp_path / "p.nvsim")]) == 2
    sentence = capsys.readouterr().err.splitlines()[-1]
    assert sentence.startswith("nvsim import: ") and "floor.ply has no ceiling" in sentence
    assert not (tmp_path / "p.nvsim").exists()


def test_options_that_need_images_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_splats(tmp_path / "room.ply", two_rooms(), False, "ply")
    words = ["import", str(tmp_path / "room.ply"), "--project", str(tmp_path / "p.nvsim")]
    assert main([*words, "--poses", "given"]) == 2
    assert "--poses needs images" in capsys.readouterr().err
    assert not (tmp_path / "p.nvsim").exists()
