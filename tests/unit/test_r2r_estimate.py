"""Compare the predicted size of an exported scan with its real size."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from scan_samples import IDS, graph, scan_project, two_rooms

from nvsim.errors import InputError
from nvsim.events import Log, Warning
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.project.project import Project
from nvsim.r2r.observations.estimate import ExportEstimate, ScanCounts, duration_text, estimate, shortage, size_words
from nvsim.r2r.observations.export import PreparedExport, export_scan
from nvsim.r2r.observations.layout import ScanPlaces, ScanSettings
from nvsim.r2r.observations.stub import SCAN

FACTOR = 2.0  # of all bytes, as the page says
ROUGHLY = 3.0  # of the bytes of one kind
ONE = ScanCounts("hall", 50, 50, 50, ((1000, 800),), 80_000.0)


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    return scan_project(tmp_path_factory.mktemp("project"))


def said(
    project: Path, out: Path, settings: ScanSettings, stub: bool = True, most: int | None = None
) -> ExportEstimate:
    with Project.open(project) as opened:
        return PreparedExport.of(opened, out, most=most).estimate(settings, stub, "numba")


def sizes(root: Path, folder: str, pattern: str) -> list[int]:
    return [p.stat().st_size for p in (root / folder).rglob(pattern) if p.is_file()]


PATTERNS = {
    "strips of six faces": "*_skybox_small.jpg",
    "depth strips": "*_skybox_depth_small.png",
    "single faces": "*_sami.jpg",
    "views": "*.jpg",
    "floor plans": "*",
    "manifest": "manifest.json",
    "table of the parts": "*-parts.csv",
}


@pytest.mark.parametrize(
    "settings",
    [
        ScanSettings(),
        ScanSettings(size=256, quality=75, faces=True, views=True),
        ScanSettings(size=128, quality=100, plans=False),
    ],
)
def test_files_are_counted_and_weighed_as_they_are_written(project, tmp_path, settings):
    out = tmp_path / "scans"
    told = said(project, out, settings)
    assert not out.exists(), "an estimate writes nothing"
    with Project.open(project) as opened:
        export_scan(opened, out, settings=settings)
    every = [p for p in out.rglob("*") if p.is_file()]
    total = sum(p.stat().st_size for p in every)
    assert told.files == len(every)
    assert total / FACTOR < told.bytes < total * FACTOR
    assert told.missing == told.bytes and told.drawn == told.todo == 4
    for kind in told.kinds:
        if kind.what in PATTERNS:
            found = sizes(out, kind.folder, PATTERNS[kind.what])
            assert len(found) == kind.files, kind.what
            assert sum(found) / ROUGHLY < kind.bytes < sum(found) * ROUGHLY, kind.what


def test_what_is_there_is_not_counted_again(project, tmp_path):
    out, settings = tmp_path / "scans", ScanSettings(size=64, plans=False)
    first = said(project, out, settings)
    with Project.open(project) as opened:
        export_scan(opened, out, settings=settings)
    before = {p: p.stat().st_mtime_ns for p in out.rglob("*")}
    again = said(project, out, settings)
    assert {p: p.stat().st_mtime_ns for p in out.rglob("*")} == before
    assert (again.drawn, again.todo) == (4, 0) and again.missing < 0.1 * first.missing
    assert again.seconds is not None and first.seconds is not None and again.seconds < first.seconds
    assert "4 of the viewpoints are already exported" in again.sentence
    assert SCAN not in [kind.folder for kind in again.kinds], "the stub is there"
    assert said(project, out, replace(settings, size=80)).todo == 4, "other settings make other images"
    ScanPlaces(out, "hall").skyboxes.depth(IDS[0]).unlink()
    assert said(project, out, settings).todo == 1


def test_parts_of_a_large_graph_are_counted_together(tmp_path):
    large, out, settings = scan_project(tmp_path), tmp_path / "scans", ScanSettings(size=64, plans=False)
    with Project.open(large, writable=True) as opened:
        opened.set_graph(two_rooms(6, 7))
    told = said(large, out, settings, stub=False, most=10)
    with Project.open(large) as opened:
        export_scan(opened, out, settings=settings, with_stub=False, most=10)
    assert told.drawn == 13 and told.files == len([p for p in out.rglob("*") if p.is_file()])


def test_more_of_anything_is_never_said_to_be_less():
    base = estimate([ONE], ScanSettings(), cores=2)
    more = (
        estimate([ONE], ScanSettings(size=640), cores=2),
        estimate([ONE], ScanSettings(views=True), cores=2),
        estimate([replace(ONE, drawn=60, todo=60)], ScanSettings(), cores=2),
    )
    for other in more:
        assert other.bytes > base.bytes and other.seconds > base.seconds
    assert estimate([ONE], ScanSettings(faces=True), cores=2).bytes > base.bytes
    assert estimate([ONE], ScanSettings(quality=60), cores=2).bytes < base.bytes
    assert estimate([ONE], ScanSettings(), cores=8).seconds < base.seconds
    assert estimate([ONE], ScanSettings(), cores=2, on_card=True).seconds is None


def test_the_connectivity_of_many_viewpoints_grows_with_their_square(tmp_path):
    from nvsim.graph.connectivity import write_connectivity

    many = {f"{i:032d}": Viewpoint(f"{i:032d}", (float(i), 0.0, 1.5)) for i in range(300)}
    path = write_connectivity(NavGraph("hall", many, {}), tmp_path)
    told = estimate([replace(ONE, viewpoints=300)], ScanSettings(), cores=2)
    kind = next(k for k in told.kinds if k.folder == "connectivity")
    assert kind.bytes == pytest.approx(path.stat().st_size, rel=0.1)


def test_a_disk_that_is_too_small_is_one_sentence():
    assert shortage(1000, 1000, "/here") == ""
    assert shortage(5_000_000_000, 1_200_000_000, "/here") == (
        "About 5.0 GB are still to be written, but only 1.2 GB are free at /here; free some space, choose another "
        "folder, or export less."
    )


@pytest.mark.parametrize(
    ("count", "words"), [(0, "0 bytes"), (999, "999 bytes"), (999_600, "1 MB"), (45e6, "45 MB"), (12.3e9, "12 GB")]
)
def test_sizes_in_words(count, words):
    assert size_words(count) == words


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(3, "less than a minute"), (61, "about 1 minute"), (600, "about 10 minutes"), (3 * 3600, "about 3 hours")],
)
def test_times_in_words(seconds, words):
    assert duration_text(seconds) == words


def test_a_run_says_it_first_and_warns_of_a_small_disk(project, tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("nvsim.r2r.observations.export.shutil.disk_usage", lambda _: usage._replace(free=1000))
    heard = []
    with Project.open(project) as opened:
        export_scan(opened, tmp_path / "scans", settings=ScanSettings(size=64, plans=False), listen=heard.append)
    assert isinstance(heard[0], Log) and heard[0].text.startswith("4 viewpoints in 14 files, about ")
    assert isinstance(heard[1], Warning) and "only 1 kB are free" in heard[1].text
    assert sum(isinstance(event, Warning) for event in heard) == 1


def nvsim(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "nvsim", "export", "scan", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_dry_run_says_it_and_writes_nothing(project, tmp_path):
    out = tmp_path / "scans"
    done = nvsim("--project", project, "--out", out, "--views", "--dry-run")
    assert done.returncode == 0 and not out.exists(), done.stderr
    assert "144" in done.stdout and "are free" in done.stdout and "less than a minute" in done.stdout
    data = json.loads(nvsim("--project", project, "--out", out, "--dry-run", "--json").stdout)
    assert data["scans"] == ["hall"] and data["todo"] == 4 and data["shortage"] == ""
    assert data["bytes"] == sum(kind["bytes"] for kind in data["kinds"])


def test_a_dry_run_refuses_what_a_run_refuses(project, tmp_path):
    copy = Path(shutil.copytree(project, tmp_path / "hall.nvsim"))
    first = graph()
    with Project.open(copy, writable=True) as opened:
        opened.set_graph(NavGraph("hall", first.viewpoints, dict(list(first.edges.items())[1:])))
    words = "--project", copy, "--out", tmp_path / "scans"
    dry, real = nvsim(*words, "--dry-run"), nvsim(*words)
    assert dry.returncode == real.returncode == 2 and dry.stderr == real.stderr and "--force" in dry.stderr
    assert nvsim(*words, "--dry-run", "--force").returncode == 0
    with Project.open(copy) as opened, pytest.raises(InputError, match="is a project"):
        PreparedExport.of(opened, copy, force=True)


def test_a_place_that_cannot_be_written_is_refused_before_anything_is_drawn(project, tmp_path, monkeypatch):
    (tmp_path / "letter.txt").write_text("dear")
    with Project.open(project) as opened:
        with pytest.raises(InputError, match="a part of the path is a file"):
            PreparedExport.of(opened, tmp_path / "letter.txt" / "scans")
        monkeypatch.setattr("os.access", lambda *_: False)  # the tests may run as root, who may write anywhere
        with pytest.raises(InputError, match="permission is denied; choose a folder"):
            PreparedExport.of(opened, tmp_path / "below" / "scans")
    assert not (tmp_path / "below").exists()
