"""The candidates in closed form against the sweep that agents do, and the files against the agents' own readers."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_samples import random_graph

from nvsim.cli.main import main
from nvsim.graph.connectivity import write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.r2r.features.candidates import Candidates, candidates_of
from nvsim.r2r.features.exported_scan import read_exported_scans
from nvsim.r2r.observations.stub import write_stub_graph


def navigable(here: np.ndarray, others: dict[str, np.ndarray], heading: float, elevation: float) -> list[tuple]:
    """The simulator's list of navigable locations at 640x480 and 60 degrees, one by one: (angle, id, heading,
    elevation), both relative to the camera."""
    found = []
    for id, there in others.items():
        dx, dy, dz = there - here
        level = math.hypot(dx, dy)
        if level == 0:
            continue
        ahead = (math.sin(heading), math.cos(heading))
        cosine = (dx * ahead[0] + dy * ahead[1]) / level
        if cosine < math.cos(math.radians(60) * 640 / 480 / 2):
            continue
        right = dx * math.cos(heading) - dy * math.sin(heading)
        rel_heading = math.atan2(right, dx * ahead[0] + dy * ahead[1])
        rel_elevation = math.atan2(dz, level) - elevation
        found.append((math.sqrt(rel_heading**2 + rel_elevation**2), id, rel_heading, rel_elevation))
    return sorted(found)


def swept(graph: NavGraph, id: str) -> dict[str, tuple[int, float, float, float]]:
    """Neighbour -> (view, angle, rel_heading, rel_elevation) after the sweep, in the order of the first sight."""
    at = {v.id: np.array(v.position) for v in graph.viewpoints.values() if v.included}
    others = {other: at[other] for other in graph.neighbors(id) if other in at}
    best: dict[str, tuple[int, float, float, float]] = {}
    for view in range(36):
        heading, elevation = math.radians(30 * (view % 12)), math.radians(30 * (view // 12 - 1))
        for angle, other, rel_heading, rel_elevation in navigable(at[id], others, heading, elevation):
            if other not in best or angle < best[other][1]:
                best[other] = (view, angle, rel_heading, rel_elevation)
    return best


def exported(folder: Path, *graphs: NavGraph) -> Path:
    for graph in graphs:
        write_connectivity(graph, folder / "connectivity")
    assert main(["export", "candidates", str(folder)]) == 0
    return folder / "candidates"


def load(path: Path) -> dict:
    return json.loads(path.read_text())


def around(*directions: tuple[float, float]) -> Candidates:
    """Candidates of a viewpoint whose neighbors lie 2 m off along headings and elevations, degrees."""
    h, e = np.radians(np.array(directions)).T
    ends = 2 * np.stack([np.sin(h) * np.cos(e), np.cos(h) * np.cos(e), np.sin(e)], -1)
    edges = np.array([(0, i + 1) for i in range(len(ends))])
    return candidates_of(np.concatenate([np.zeros((1, 3)), ends]), edges)


@pytest.mark.parametrize("seed", range(4))
def test_candidates_are_those_of_the_sweep_in_its_order(tmp_path: Path, seed: int) -> None:
    graph = random_graph("Hall", 60, seed)
    rows = load(exported(tmp_path, graph) / "scanvp_candview_relangles.json")
    assert len(rows) == 59  # one viewpoint is not included
    for key, row in rows.items():
        expected = swept(graph, key.removeprefix("Hall_"))
        assert list(row) == list(expected)
        for id, found in row.items():
            assert found[0] == expected[id][0]
            np.testing.assert_allclose(found[1:], expected[id][1:], atol=1e-9)
    assert sum(map(len, rows.values())) > 300


def test_between_views_that_are_as_near_the_lowest_index_counts() -> None:
    found = around((45, 0), (345, 0), (15, 15), (0, 15), (300, -15), (0, -60), (0, 70))
    views = dict(zip(found.target.tolist(), found.view.tolist(), strict=True))
    # 45 degrees lies between the views of 30 and 60; 345 between those of 330 and 0, which comes first.
    assert views == {1: 13, 2: 12, 3: 12, 4: 12, 5: 10, 6: 0, 7: 24}


def test_a_lattice_has_the_same_view_for_the_same_direction_everywhere() -> None:
    """The simulator's 32 bits decide 45 degrees differently from one viewpoint to the next."""
    step = 1.3
    positions = np.array([(step * i + 0.1, step * j - 7.3, 1.5) for i in range(30) for j in range(30)])
    edges = [(30 * i + j, 30 * (i + 1) + j + 1) for i in range(29) for j in range(29)]
    found = candidates_of(positions, np.array(edges))
    assert set(found.view.tolist()) == {13}


def test_what_is_straight_above_is_named_and_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    viewpoints = {id: Viewpoint(id, p) for id, p in {"a": (0, 0, 1), "b": (0, 0, 3), "c": (1, 0, 1)}.items()}
    graph = NavGraph("Shaft", viewpoints, {("a", "b"): edge("a", "b"), ("a", "c"): edge("a", "c")})
    rows = load(exported(tmp_path, graph) / "scanvp_candidates.json")
    assert set(rows["Shaft_a"]) == {"c"} and rows["Shaft_b"] == {}
    assert "2 edges are vertical" in capsys.readouterr().err


def test_navgpt2_and_same_find_what_they_read(tmp_path: Path) -> None:
    graph = random_graph("Hall", 40)
    out = exported(tmp_path, graph)
    navgpt2, same = load(out / "scanvp_candidates.json"), load(out / "mp3d_scanvp_candidates.json")
    places = load(out / "mp3d_connectivity_graphs.json")["Hall"]
    for id in (v.id for v in graph.viewpoints.values() if v.included):
        expected = swept(graph, id)
        assert list(navgpt2[f"Hall_{id}"]) == list(same[f"Hall_{id}"]) == list(expected)
        # As the readers unpack it: pointId, featureId (not SAME), distance, heading, elevation, position.
        for k, (other, value) in enumerate(navgpt2[f"Hall_{id}"].items()):
            point, feature, distance, heading, elevation, position = value
            there, here = np.array(graph.viewpoints[other].position), np.array(graph.viewpoints[id].position)
            assert feature == k and tuple(position) == pytest.approx(tuple(there)) == tuple(places[other])
            assert distance == pytest.approx(np.linalg.norm(there - here))
            view, _, rel_heading, rel_elevation = expected[other]
            assert point == view
            assert heading == pytest.approx(math.radians(30 * (view % 12)) + rel_heading)
            assert elevation == pytest.approx(math.radians(30 * (view // 12 - 1)) + rel_elevation)
            assert same[f"Hall_{id}"][other] == [point, distance, heading, elevation, position]


def sector(heading: float) -> int:
    """The eighth of the horizon into which NavGPT puts a candidate; those beyond 0 to 7 it never shows."""
    return int((np.rad2deg(heading) - 22.5) // 45) + 1


def row_of_views(heading: float) -> int:
    """What simulators over navigable.json make of a level heading: a viewIndex."""
    return int((math.degrees(heading) + 15) // 30 + 12)


def test_navgpt_drops_no_candidate(tmp_path: Path) -> None:
    graph = random_graph("Hall", 80, 3)
    out = exported(tmp_path, graph)
    own, copies, places = (load(out / n) for n in ("navigable/Hall_navigable.json", "navigable.json", "location.json"))
    seen = set()
    for id, candidates in own.items():
        assert set(candidates) == set(copies["Hall"][id]) == set(swept(graph, id))
        for other, at in candidates.items():
            there, here = np.array(graph.viewpoints[other].position), np.array(graph.viewpoints[id].position)
            dx, dy, dz = there - here
            assert math.cos(at["heading"] - math.atan2(dx, dy)) == pytest.approx(1)
            assert at["elevation"] == pytest.approx(math.atan2(dz, math.hypot(dx, dy)))
            assert at["distance"] == pytest.approx(np.linalg.norm(there - here))
            seen.add(sector(at["heading"]))
            assert 12 <= row_of_views(copies["Hall"][id][other]["heading"]) < 24
            assert copies["Hall"][id][other]["distance"] == at["distance"]
        assert tuple(places["Hall"][id]) == pytest.approx(graph.viewpoints[id].position)
    assert seen == set(range(8))


def test_scans_share_the_files_that_are_not_of_one_scan(tmp_path: Path) -> None:
    out = exported(tmp_path, random_graph("Hall", 9), random_graph("Barn", 7, 1))
    assert {key.split("_")[0] for key in load(out / "scanvp_candidates.json")} == {"Hall", "Barn"}
    assert set(load(out / "location.json")) == {"Hall", "Barn"}
    assert {p.name for p in (out / "navigable").iterdir()} == {"Hall_navigable.json", "Barn_navigable.json"}


def test_a_scan_that_is_not_listed_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_connectivity(random_graph("Hall", 5), tmp_path)
    write_stub_graph(tmp_path)
    assert main(["export", "candidates", str(tmp_path), "--scans", "Barn"]) == 2
    sentence = f"The scan Barn is not listed in {tmp_path / 'scans.txt'}; choose one of Hall."
    assert capsys.readouterr().err == f"nvsim export candidates: {sentence}\n"
    assert not (tmp_path / "candidates").exists()


def test_no_scan_is_offered_if_only_the_stub_is_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_stub_graph(tmp_path)
    assert main(["export", "candidates", str(tmp_path), "--scans", "Barn"]) == 2
    assert "lists no scan; export one into the folder." in capsys.readouterr().err


def test_viewpoints_whose_ids_are_paths_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    graph = random_graph("Hall", 3)
    write_connectivity(replace(graph, viewpoints={"..": Viewpoint("..", (0, 0, 0))}, edges={}), tmp_path)
    assert main(["export", "candidates", str(tmp_path)]) == 2
    assert "cannot be the name of image files" in capsys.readouterr().err


def test_poses_are_read_with_their_rotation(tmp_path: Path) -> None:
    write_connectivity(random_graph("Hall", 3), tmp_path / "connectivity")
    path = tmp_path / "connectivity" / "Hall_connectivity.json"
    entries = load(path)
    entries[0]["pose"] = [0, 0, 1, 5, -1, 0, 0, 6, 0, -1, 0, 7, 0, 0, 0, 1]
    path.write_text(json.dumps(entries))
    (scan,) = read_exported_scans(tmp_path)
    assert scan.viewpoints == ("hall000", "hall002")
    np.testing.assert_array_equal(scan.rotations[0], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    np.testing.assert_array_equal(scan.rotations[1], [[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    np.testing.assert_array_equal(scan.positions[0], [5, 6, 7])
