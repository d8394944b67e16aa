"""Each export is read by another program's reader. Graphs that agents cannot load are refused."""

from __future__ import annotations

import itertools
import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import cv2
import networkx as nx
import numpy as np
import pytest

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.figures import save_figure
from nvsim.graph import edits
from nvsim.graph.connectivity import read_connectivity, write_connectivity
from nvsim.graph.exports import (
    GeoAnchor,
    check_exportable,
    draw,
    findings_that_break_agents,
    write_geojson,
    write_graphml,
)
from nvsim.graph.findings import Context
from nvsim.graph.sight import lines_of_sight
from nvsim.graph.types import NavGraph, Viewpoint, edge
from nvsim.occupancy.types import OccupancyMap

PLACES = {"a": (0.0, 0.0, 1.5), "b": (3.0, 4.0, 1.5), "c<&": (6.0, 0.0, 1.25)}
GRAPH = NavGraph(
    "house",
    {id: Viewpoint(id, p, 1.4, included=id != "c<&") for id, p in PLACES.items()},
    {e.key: e for e in (edge("a", "b"), edge("b", "c<&", "person"))},
)


def test_networkx_reads_the_graphml_back(tmp_path: Path) -> None:
    found = nx.read_graphml(write_graphml(GRAPH, tmp_path / "g.graphml"))
    assert not found.is_directed() and found.graph["scan"] == "house"
    assert {n: (d["x"], d["y"], d["z"], d["included"]) for n, d in found.nodes(data=True)} == {
        id: (*p, id != "c<&") for id, p in PLACES.items()
    }
    assert {frozenset(k) for k in found.edges} == {frozenset(k) for k in GRAPH.edges}
    assert found.edges["a", "b"]["length"] == 5.0
    assert nx.dijkstra_path_length(found, "a", "c<&") == pytest.approx(5 + np.sqrt(25 + 0.0625))


def test_geojson_says_that_its_coordinates_are_local_meters(tmp_path: Path) -> None:
    found = json.loads(write_geojson(GRAPH, tmp_path / "g.geojson").read_text())
    assert found["type"] == "FeatureCollection" and "local meters" in found["note"]
    points = [f for f in found["features"] if f["geometry"]["type"] == "Point"]
    lines = [f for f in found["features"] if f["geometry"]["type"] == "LineString"]
    assert [f["geometry"]["coordinates"] for f in points] == [list(p) for p in PLACES.values()]
    assert lines[0]["geometry"]["coordinates"] == [list(PLACES["a"]), list(PLACES["b"])]
    assert lines[0]["properties"]["length"] == 5.0


def ecef(longitude: float, latitude: float, height: float) -> np.ndarray:
    """Closed form of WGS 84, to measure distances that were made on the tangent plane."""
    lon, lat = np.radians([longitude, latitude])
    e2 = 6.69437999014e-3
    n = 6378137.0 / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    return np.array([(n + height) * np.cos(lat) * np.cos(lon), (n + height) * np.cos(lat) * np.sin(lon),
                     (n * (1 - e2) + height) * np.sin(lat)])  # fmt: skip


@pytest.mark.parametrize("latitude", [0.0, 48.26, -67.0])
def test_an_anchor_keeps_distances_and_directions(latitude: float) -> None:
    anchor = GeoAnchor(latitude, 11.67, bearing=30.0)
    origin = ecef(*anchor.place(0, 0, 0))
    for x, y in ((100.0, 0.0), (0.0, 100.0), (-70.0, 45.0)):
        assert np.linalg.norm(ecef(*anchor.place(x, y, 0)) - origin) == pytest.approx(np.hypot(x, y), abs=2e-3)
    lon, lat, _ = anchor.place(0, 100, 0)
    east, north = (lon - 11.67) * np.cos(np.radians(latitude)), lat - latitude
    assert np.degrees(np.arctan2(east, north)) == pytest.approx(30.0, abs=0.5)


def test_places_off_the_earth_are_refused() -> None:
    with pytest.raises(InputError, match="not valid"):
        GeoAnchor(95.0, 0.0)


def test_pictures_show_the_map_the_edges_and_the_viewpoints(tmp_path: Path) -> None:
    cells = np.zeros((100, 120), np.uint8)
    cells[60:, :20] = 1
    occupancy = OccupancyMap(cells, 0.1, (-2.0, -2.0))
    figure = draw(GRAPH, occupancy, 800)
    pixels = cv2.imread(str(save_figure(figure, tmp_path / "g.png")))
    scale = 800 / (12.0 + 1.6)
    assert pixels.shape[1] == 800 and pixels.shape[0] > 11.6 * scale, "with a legend"

    def at(x: float, y: float) -> list[int]:
        return pixels[round((8.8 - y) * scale), round((x + 2.8) * scale)].tolist()

    assert at(-1.5, 7.0) == [70, 70, 70] and at(6.0, 7.0) == [252, 252, 252], "occupied above, free"
    assert at(0, 0) == [52, 78, 24] and at(1.5, 2.0) == [84, 125, 46], "a viewpoint, an edge; blue, green, red"
    svg = ET.parse(save_figure(figure, tmp_path / "g.svg")).getroot()
    names = [t.text for t in svg.iter("{http://www.w3.org/2000/svg}title")]
    assert names == ["house", *PLACES]
    texts = [t.text for t in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert texts == ["2 m", "steps of the search", "not in navigation", "viewpoints"]
    assert save_figure(figure, tmp_path / "g.pdf").read_bytes()[:5] == b"%PDF-"
    plain = cv2.imread(str(save_figure(draw(GRAPH, None, 200), tmp_path / "plain.png")))
    assert plain.shape[1] == 200 and (plain[0, 0] == 255).all()
    with pytest.raises(InputError, match="no viewpoint and no map"):
        draw(NavGraph("s"))


def test_what_agents_choke_on_is_refused_unless_ignored() -> None:
    assert findings_that_break_agents(GRAPH) == []
    lonely = edits.place_viewpoint(GRAPH, (9, 9, 1.5), id="d")
    with pytest.raises(InputError, match=r"Viewpoint d has no edge.*--force"):
        check_exportable(lonely)
    check_exportable(edits.ignore_finding(lonely, "isolated/d", "it is a view from the roof"))
    with pytest.raises(InputError, match="scan id"):
        check_exportable(replace(GRAPH, scan="two_words"))
    with pytest.raises(InputError, match="one way only"):
        check_exportable(GRAPH, Context(one_way=frozenset({("a", "b")})))


def test_the_command_writes_every_format_and_forces_what_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lonely = edits.place_viewpoint(GRAPH, (9, 9, 1.5), id="d")
    path, out = write_connectivity(lonely, tmp_path), tmp_path / "out"
    for name in ("graphml", "geojson", "svg", "png"):
        assert main(["export", "graph", str(path), "--format", name, "--out", str(out)]) == 0
    assert {p.suffix for p in out.iterdir()} == {".graphml", ".geojson", ".svg", ".png"}
    assert main(["export", "graph", str(path), "--format", "r2r", "--out", str(out)]) == 2
    assert "has no edge" in capsys.readouterr().err and not (out / "scans.txt").exists()
    assert main(["export", "graph", str(path), "--format", "r2r", "--out", str(out), "--force"]) == 0
    assert list(read_connectivity(out / "house_connectivity.json").viewpoints) == [*PLACES, "d"]
    assert (out / "scans.txt").read_text() == "house\n"
    assert main(["export", "graph", str(path), "--format", "geojson", "--latitude", "4"]) == 2


def test_what_is_wrong_with_one_scan_of_a_folder_does_not_keep_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lonely = edits.place_viewpoint(GRAPH, (9, 9, 1.5), id="d")
    given, out = tmp_path / "given", tmp_path / "out"
    for name, graph in (("one", GRAPH), ("two", lonely), ("three", GRAPH), ("four", GRAPH), ("five", GRAPH)):
        write_connectivity(replace(graph, scan=name), given)
    (given / "four_connectivity.json").write_text("[")
    command = ["export", "graph", str(given), "--format", "r2r", "--out", str(out)]
    assert main(command) == 2
    assert (out / "scans.txt").read_text().split() == ["one", "three", "five"]
    told = capsys.readouterr()
    assert told.out.count("Wrote") == 3 and len(told.err.splitlines()) == 1
    assert "2 of 5 scans were not written (two: Viewpoint d has no edge" in told.err and "; four: " in told.err
    assert main([*command, "--force"]) == 2, "a file that cannot be read stays out"
    assert "1 of 5" in capsys.readouterr().err and "two" in (out / "scans.txt").read_text().split()
    for name in ("one", "three", "five", "two"):
        assert (out / f"{name}_connectivity.json").read_bytes() == (given / f"{name}_connectivity.json").read_bytes()


def test_visible_is_line_of_sight_where_a_map_can_tell() -> None:
    cells = np.zeros((60, 200), np.uint8)
    cells[:40, 50] = 1  # a wall at x = 5 up to y = 4
    occupancy = OccupancyMap(cells, 0.1, (0.0, 0.0))
    places = {
        "a": (1, 1, 1.5),
        "b": (4, 1, 1.5),
        "c": (8, 1, 1.5),
        "d": (8, 5, 1.5),
        "e": (18.5, 5, 1.5),
        "f": (4, 2, 4.5),
    }
    graph = NavGraph("s", {id: Viewpoint(id, p) for id, p in places.items()}, {k.key: k for k in (edge("b", "c"),)})
    seen = lines_of_sight(graph, occupancy)
    assert seen is not None and lines_of_sight(graph, None) is None
    for a, b in itertools.permutations(graph.viewpoints.values(), 2):
        along = np.linspace(a.position, b.position, 5000)  # small steps in place of a walk from cell to cell
        clear = not occupancy.states_at(along[:, :2]).any() and np.ptp(along[:, 2]) < 1
        wanted = {a.id, b.id} == {"b", "c"} or (clear and math.dist(a.position, b.position) < 16)
        assert seen(a, b) == wanted, f"{a.id} {b.id}"
    told = {a + b for a in places for b in places if a < b and seen(graph.viewpoints[a], graph.viewpoints[b])}
    assert {"ab", "bc", "cd"} <= told and not told & {"ac", "ad", "ae", "af"}


def test_an_exported_project_says_who_sees_whom_by_its_map(tmp_path: Path) -> None:
    write_connectivity(
        GRAPH, tmp_path, lines_of_sight(GRAPH, OccupancyMap(np.zeros((99, 99), np.uint8), 0.1, (-1, -1)))
    )
    a, b, c = json.loads((tmp_path / "house_connectivity.json").read_text())
    assert a["visible"] == [False, True, True] and a["unobstructed"] == [False, True, False]
