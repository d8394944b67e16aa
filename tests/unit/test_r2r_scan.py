"""The export of a scan: whole, resumable to the byte, and never over what is not ours."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scan_samples import IDS, graph, scan_project, two_rooms

from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.cluster.piece import WorkCall, WorkItem
from nvsim.errors import InputError
from nvsim.events import Progress, Worker
from nvsim.graph.connectivity import read_connectivity, read_scans, write_connectivity
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.project.project import Project
from nvsim.r2r.observations import drawing, stub
from nvsim.r2r.observations.export import export_scan
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings
from nvsim.r2r.observations.skybox import visible_from

SMALL = ScanSettings(size=64, plans=False)


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    return scan_project(tmp_path_factory.mktemp("project"))


def export(project: Path, out: Path, settings: ScanSettings = SMALL, **more) -> ScanPlaces:
    with Project.open(project) as opened:
        return export_scan(opened, out, settings=settings, **more)[0]


def content(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def whole(project, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "scans"
    export(project, out, ScanSettings(size=64, faces=True, views=True))
    return out


def test_everything_is_there(whole):
    names = set(content(whole))
    for id in IDS[:4]:
        expected = {f"hall/matterport_skybox_images/{id}_skybox{end}" for end in ("_small.jpg", "_depth_small.png")}
        expected |= {f"hall/matterport_skybox_images/{id}_skybox{i}_sami.jpg" for i in range(6)}
        expected |= {f"views/hall/{id}/{i}.jpg" for i in range(36)}
        assert expected <= names
    assert not any(IDS[4] in name for name in names), "what is left out of navigation has no pictures"
    assert {"connectivity/scans.txt", "connectivity/hall_connectivity.json", "hall/manifest.json"} <= names
    assert {f"floor_plans/hall/{n}" for n in ("storey_1.png", "storey_1_graph.png", "floor_plans.json")} <= names
    assert not any("/." in name for name in names)


def test_connectivity_is_the_graph(whole):
    read = read_connectivity(whole / "connectivity" / "hall_connectivity.json")
    assert list(read.viewpoints) == IDS and set(read.edges) == set(graph().edges)
    entries = json.loads((whole / "connectivity" / "hall_connectivity.json").read_text())
    assert entries[0]["visible"][1], "neighbours in an open hall"
    assert not entries[0]["visible"][0] and not any(entries[4]["visible"])


def test_single_faces_are_those_of_the_strip(whole):
    images = whole / "hall" / "matterport_skybox_images"
    strip = cv2.imread(str(images / f"{IDS[0]}_skybox_small.jpg")).astype(int)
    for i in range(6):
        face = cv2.imread(str(images / f"{IDS[0]}_skybox{i}_sami.jpg")).astype(int)
        assert np.abs(face - strip[:, 64 * i : 64 * (i + 1)]).mean() < 1


def test_the_editor_shows_a_strip_as_the_panorama_of_the_model(project, whole):
    from nvsim.graph.foreign.neighboring_files import find_files_beside, panorama
    from nvsim.render.panorama import render_equirectangular

    beside = find_files_beside(whole / "connectivity" / "hall_connectivity.json", "hall")
    facing_y = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
    shown = panorama(beside, IDS[0], facing_y, 256)[..., ::-1].astype(float)
    with Project.open(project) as opened:
        direct = render_equirectangular(opened.scene(), np.array(graph().viewpoints[IDS[0]].position), 256, 128).rgb
    error = np.abs(shown - 255 * direct.clip(0, 1)).mean()
    turned = np.abs(np.roll(shown, 8, axis=1) - 255 * direct.clip(0, 1)).mean()
    assert error < 8 and error < 0.5 * turned


def test_a_plan_says_where_viewpoints_are(whole):
    plans = whole / "floor_plans" / "hall"
    storey = json.loads((plans / "floor_plans.json").read_text())["storeys"][0]
    plain, drawn = (cv2.imread(str(plans / storey[name])).astype(int) for name in ("plan", "plan_with_graph"))
    assert plain.shape == drawn.shape == (storey["height"], storey["width"], 3)
    for id, (column, row) in storey["viewpoints"].items():
        x, y, _ = graph().viewpoints[id].position
        np.testing.assert_allclose(np.array(storey["world_to_pixel"]) @ [x, y, 1], (column, row))
        if id != IDS[4]:
            assert drawn[int(row), int(column)].tolist() == [40, 30, 170], "the disc of a viewpoint (blue, green, red)"
    (ax, ay), (bx, by) = (storey["viewpoints"][id] for id in IDS[:2])
    assert bx > ax and by < ay, "+x is to the right, +y is up"


def test_what_is_finished_is_not_done_again(project, tmp_path):
    out = tmp_path / "scans"
    export(project, out)
    before = {name: os.stat(out / name).st_mtime_ns for name in content(out) if "skybox" in name}
    heard = []
    export(project, out, listen=heard.append)
    assert before == {name: os.stat(out / name).st_mtime_ns for name in content(out) if "skybox" in name}
    assert [e.done for e in heard if isinstance(e, Progress)] == [4]


def test_a_viewpoint_that_moved_and_a_file_that_is_gone_are_made_again(project, tmp_path):
    out = tmp_path / "scans"
    export(project, out)
    first = content(out)
    copy = tmp_path / "moved.nvsim"
    shutil.copytree(project, copy)
    with Project.open(copy, writable=True) as opened:
        old = opened.need_graph()
        there = {**old.viewpoints, IDS[1]: Viewpoint(IDS[1], (5.0, 4.0, 1.5))}
        opened.set_graph(NavGraph("hall", there, old.edges))
    ScanPlaces(out, "hall").skyboxes.depth(IDS[0]).unlink()
    heard = []
    export(copy, out, scan="hall", listen=heard.append)
    assert [e.done for e in heard if isinstance(e, Progress)] == [2, 3, 4]
    second = content(out)
    changed = {name for name in first if first[name] != second[name] and "skybox" in name}
    assert changed == {n for n in first if IDS[1] in n}


def test_what_is_no_longer_asked_for_is_removed_and_other_files_stay(project, tmp_path):
    out = tmp_path / "scans"
    export(project, out, ScanSettings(size=64, plans=False, faces=True))
    mine = out / "hall" / "matterport_skybox_images" / "notes.txt"
    mine.write_text("mine")
    places = export(project, out)
    assert not any(path.exists() for path in places.skyboxes.faces(IDS[0])) and places.skyboxes.strip(IDS[0]).exists()
    assert mine.read_text() == "mine"


def test_a_killed_export_goes_on_to_the_same_bytes(project, tmp_path):
    out, journal = tmp_path / "killed", tmp_path / "killed" / "hall" / ".unfinished.jsonl"
    command = [sys.executable, "-m", "nvsim", "export", "scan", "--project", str(project), "--size", "64", "--views"]
    child = subprocess.Popen([*command, "--out", str(out)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not (journal.exists() and journal.read_bytes().count(b"\n") >= 2):
        assert child.poll() is None and time.monotonic() < deadline, "it ended before it was killed"
        time.sleep(0.002)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert not (out / "hall" / "manifest.json").exists()
    # What a killed write leaves, and a line that was cut off.
    (out / "hall" / "matterport_skybox_images" / f".{IDS[2][:40]}-abc.jpg").write_bytes(b"half")
    with journal.open("ab") as file:
        file.write(b'{"part": "')
    assert subprocess.run([*command, "--out", str(out)], capture_output=True, check=False).returncode == 0
    again = tmp_path / "whole"
    assert subprocess.run([*command, "--out", str(again)], capture_output=True, check=False).returncode == 0
    assert content(out) == content(again)


def test_another_scan_in_the_folder_stays_as_it_is(project, tmp_path):
    out = tmp_path / "scans"
    write_connectivity(NavGraph("other", {"v": Viewpoint("v", (0.0, 0.0, 1.5))}, {}), out / "connectivity")
    (out / "other").mkdir()
    (out / "other" / "x").write_text("x")
    before = content(out)
    export(project, out)
    assert read_scans(out / "connectivity" / "scans.txt") == ["other", "hall", stub.SCAN]
    after = content(out)
    assert {name: after[name] for name in before if name != "connectivity/scans.txt"} == {
        name: data for name, data in before.items() if name != "connectivity/scans.txt"
    }


def test_a_scan_that_is_not_ours_is_refused(project, tmp_path):
    write_connectivity(NavGraph("other", {"v": Viewpoint("v", (0.0, 0.0, 1.5))}, {}), tmp_path / "connectivity")
    (tmp_path / "hall").mkdir()
    (tmp_path / "hall" / "house_segmentations").write_text("")
    before = content(tmp_path)
    with pytest.raises(InputError, match="did not write"):
        export(project, tmp_path)
    assert content(tmp_path) == before


def test_folders_of_other_things_are_refused(project, tmp_path):
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "dear.txt").write_text("")
    with pytest.raises(InputError, match=r"other files \(dear.txt\)"):
        export(project, tmp_path / "letters")
    with pytest.raises(InputError, match="is a project"):
        export(project, project)
    with pytest.raises(InputError, match="is a file"):
        export(project, tmp_path / "letters" / "dear.txt")


def test_a_real_scan_of_the_stubs_name_is_never_touched(project, tmp_path):
    real = tmp_path / stub.SCAN / "matterport_skybox_images" / "0b_skybox_small.jpg"
    real.parent.mkdir(parents=True)
    real.write_bytes(b"real")
    write_connectivity(NavGraph(stub.SCAN, {"v": Viewpoint("v", (0.0, 0.0, 1.5))}, {}), tmp_path / "connectivity")
    before = content(tmp_path)
    export(project, tmp_path)
    after = content(tmp_path)
    assert all(after[name] == data for name, data in before.items() if "scans.txt" not in name)
    assert not any(stub.VIEWPOINT in name for name in after)


def test_the_stub_is_a_room_that_depth_and_picture_agree_on(whole):
    images = whole / stub.SCAN / "matterport_skybox_images"
    assert stub.VIEWPOINT in read_connectivity(whole / "connectivity" / f"{stub.SCAN}_connectivity.json").viewpoints
    depth = cv2.imread(str(images / f"{stub.VIEWPOINT}_skybox_depth_small.png"), cv2.IMREAD_UNCHANGED) / 4000
    strip = cv2.imread(str(images / f"{stub.VIEWPOINT}_skybox_small.jpg"))
    middles = [depth[256, 512 * i + 256] for i in range(6)]
    np.testing.assert_allclose(middles, [1.2, 2.5, 3.0, 2.5, 3.0, 1.5], atol=0.001)
    assert strip.shape == (512, 3072, 3) and (whole / "views" / stub.SCAN / stub.VIEWPOINT / "35.jpg").exists()


def test_without_stub_there_is_none(project, tmp_path):
    export(project, tmp_path / "scans", with_stub=False)
    assert read_scans(tmp_path / "scans" / "connectivity" / "scans.txt") == ["hall"]


@pytest.mark.parametrize(
    ("scan", "words"),
    [("my_hall", "without underscore"), (stub.SCAN, "choose another --scan"), ("..", "cannot be used")],
)
def test_names_that_agents_cannot_use_are_refused(project, tmp_path, scan, words):
    with pytest.raises(InputError, match=words):
        export(project, tmp_path / "scans", scan=scan)
    assert not (tmp_path / "scans").exists()


def test_a_large_graph_is_written_in_parts(tmp_path):
    large = scan_project(tmp_path)
    with Project.open(large, writable=True) as opened:
        opened.set_graph(two_rooms(5, 5))
    with Project.open(large) as opened:
        written = export_scan(opened, tmp_path / "scans", "house", SMALL, with_stub=False, most=10)
    assert [p.scan for p in written] == ["house"], "ten are not more than ten"
    with Project.open(large, writable=True) as opened:
        opened.set_graph(two_rooms(6, 7))
    done = subprocess.run(
        [sys.executable, "-m", "nvsim", "export", "scan", "--project", large, "--out", tmp_path / "parts",
         "--size", "64", "--no-plans", "--max-viewpoints", "10"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "hall-a" in done.stdout and "hall-b" in done.stdout and "1 edges between them" in done.stderr
    rows = [line.split(",") for line in (tmp_path / "parts" / "hall-parts.csv").read_text().splitlines()]
    assert rows[0] == ["scan", "viewpoint", "x", "y", "z"]
    assert {(scan, id[0]) for scan, id, *_ in rows[1:]} == {("hall-a", "0"), ("hall-b", "1")} and len(rows) == 14
    assert read_scans(tmp_path / "parts" / "connectivity" / "scans.txt") == ["hall-a", "hall-b", stub.SCAN]


def test_a_model_that_is_missing_is_named(project, tmp_path):
    copy = tmp_path / "half.nvsim"
    shutil.copytree(project, copy)
    with Project.open(copy) as opened:
        shutil.rmtree(opened.layout.model(1))
    done = subprocess.run(
        [sys.executable, "-m", "nvsim", "export", "scan", "--project", copy, "--out", tmp_path / "scans"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and "Submap 1" in done.stderr and "nvsim train" in done.stderr
    assert not (tmp_path / "scans").exists()


@pytest.mark.parametrize("values", [{"size": 100}, {"size": 32}, {"size": 4096}, {"quality": 20}])
def test_settings_that_cannot_be_are_refused(values):
    with pytest.raises(InputError, match="give --"):
        ScanSettings(**values)


def test_a_full_disk_is_one_sentence(project, tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("nvsim.files.atomic.os.replace", full)
    with pytest.raises(InputError, match="disk is full"):
        export(project, tmp_path / "scans")


def test_depth_of_panorama_faces_is_along_the_ray(project, tmp_path):
    for form in ([], ["--faces"]):
        command = [sys.executable, "-m", "nvsim", "panorama", "--project", project, "--at", "4", "3", "1.5", *form]
        out = tmp_path / f"image{len(form)}.png"
        subprocess.run(
            [*command, "--size", "128", "--also", "depth", "unseen", "--out", out], check=True, capture_output=True
        )
    around, strip = (cv2.imread(str(tmp_path / f"image{n}_depth.png"), cv2.IMREAD_UNCHANGED) for n in (0, 1))
    faces = np.arange(4) * 128 + 128 + 1  # the left edges of the four faces round about, which look 45 degrees aside
    headings = np.array([135, 225, 315, 45])  # back, left, front, right, less 45
    columns = ((headings + 180) % 360 / 360 * 256).astype(int)
    np.testing.assert_allclose(strip[64, faces], around[64, columns], rtol=0.1)
    around, strip = (cv2.imread(str(tmp_path / f"image{n}_unseen.png"), cv2.IMREAD_UNCHANGED) for n in (0, 1))
    assert around.shape == (128, 256) and strip.shape == (128, 768)
    assert set(np.unique(around)) | set(np.unique(strip)) <= {0, 255}


def test_a_wall_hides_what_is_behind_it(tmp_path):
    places = ScanPlaces(tmp_path, "room")
    here = Viewpoint("here", (0.0, 0.0, 1.5))
    depth = np.zeros((64, 384), np.uint16)  # nothing stands anywhere
    depth[:, 3 * 64 : 4 * 64] = 3 * 4000  # but in front, three meters away
    places.images.mkdir(parents=True)
    cv2.imwrite(str(places.skyboxes.depth("here")), depth)
    others = [(0.0, 2.0), (0.0, 3.2), (0.0, 4.0), (5.0, 0.0), (-15.0, 0.0), (-17.0, 0.0), (0.0, 0.0)]
    seen = visible_from(places, here, [Viewpoint(str(i), (*xy, 1.5)) for i, xy in enumerate(others)])
    assert seen.tolist() == [True, True, False, True, True, False, False]


def test_a_cluster_draws_what_this_machine_draws(project, whole, tmp_path, ray_head):
    with open_executor(ClusterConfig("ray", ray_head)) as executor:
        for storage, views in (("auto", True), ("sent", False)):
            heard: list[object] = []
            executor.storage = storage
            settings = ScanSettings(size=64, faces=True, views=views)
            export(project, tmp_path / storage, settings, listen=heard.append, executor=executor)
            assert any(isinstance(e, Worker) for e in heard)
            ours, theirs = content(whole), content(tmp_path / storage)
            if not views:
                ours = {name: data for name, data in ours.items() if not name.startswith("views/")}
            assert ours.keys() == theirs.keys()
            for name in (n for n in ours if n.endswith((".jpg", ".png"))):
                a, b = (cv2.imdecode(np.frombuffer(d[name], np.uint8), cv2.IMREAD_UNCHANGED) for d in (ours, theirs))
                # Kernels that this process compiled may round otherwise than those that a worker read.
                assert np.mean(a != b) < 0.01


@pytest.mark.parametrize("id", ["nowhere", IDS[1]])
def test_a_worker_that_reports_a_viewpoint_of_another_piece_is_refused(
    id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Wrong:
        machines, storage = (1,), "shared"

        def run(
            self, pieces: list[WorkItem], begin: Callable[[WorkItem], WorkCall]
        ) -> Iterator[tuple[WorkItem, object]]:
            begin(pieces[0])
            yield pieces[0], Progress("scan", 1, 1, id)

    monkeypatch.setattr(drawing, "gaussian_count", lambda folder: 10)
    monkeypatch.setattr(drawing, "_MOST", 1)
    source: Any = SimpleNamespace(folders={0: tmp_path})
    todo = [(0, Viewpoint(i, (0.0, 0.0, 1.5)), "key") for i in IDS[:2]]
    places = ScanPlaces(tmp_path / "scans", "hall")
    executor: Any = Wrong()
    with pytest.raises(InputError, match="check that worker"):
        list(drawing.draw_on_workers(executor, source, todo, places, SMALL, "numba", print))
