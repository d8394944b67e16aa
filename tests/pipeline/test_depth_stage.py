"""The built-in building without its scan: depth of the images takes the scan's place in every later stage."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nvsim.building import BuildingConfig, generate
from nvsim.cli.main import main
from nvsim.depth.cloud_file import read_cloud_file
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError
from nvsim.events import Done, Event, Log, Progress, ignore_event
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig
from nvsim.project.earlier_results import kept_results, replaced_result_sentence, restore
from nvsim.project.outdated import outdated_stages
from nvsim.project.project import Project
from nvsim.project.stages import depths, floors, imported, submaps
from nvsim.project.stages.trained import adapt_to_capture, train_key
from nvsim.project.state.results import first_outdated_stage
from nvsim.project.work import StageName
from nvsim.submaps.split import SubmapConfig
from nvsim.training.config import ScanlessConfig, TrainingConfig
from nvsim_app.state.loading import Contents, ProjectReader

SMALL = ["--longest-side", "128", "--planes", "64"]
CONFIG = DepthConfig(longest_side=128, planes=64)


def few_frames(folder: Path, building: Path, count: int, cloud: bool) -> Path:
    """A capture of the first images of a building, with its scan or without."""
    shutil.copytree(building / "capture", folder)
    path = folder / "transforms.json"
    tree = json.loads(path.read_text())
    tree["frames"] = tree["frames"][:count]
    if not cloud:
        (folder / tree.pop("ply_file_path")).unlink()
    path.write_text(json.dumps(tree))
    return folder


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("building")
    generate(folder, BuildingConfig(size="small", width=192, height=144, step=0.3, turn=15.0, people=False))
    return folder


@pytest.fixture(scope="module")
def made(building: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose depth and floors were found by the command line, without a scan and without a camera height."""
    folder = tmp_path_factory.mktemp("made")
    capture = few_frames(folder / "capture", building, 40, cloud=False)
    here = ["--project", str(folder / "rooms.nvsim")]
    assert main(["import", str(capture), *here]) == 0
    assert main(["submaps", *here, "--count", "1"]) == 0
    assert main(["depth", *here, *SMALL]) == 0
    assert main(["floors", *here]) == 0
    return folder / "rooms.nvsim"


@pytest.fixture
def project(made: Path, tmp_path: Path) -> Iterator[Project]:
    with Project.open(shutil.copytree(made, tmp_path / "rooms.nvsim"), writable=True) as opened:
        yield opened


@pytest.fixture
def scanned(building: Path, tmp_path: Path) -> Iterator[Project]:
    """A project whose capture has a scan."""
    capture = few_frames(tmp_path / "scanned", building, 24, cloud=True)
    with Project.create_or_open(tmp_path / "scanned.nvsim") as opened:
        imported.run(opened, capture, CaptureConfig(), ignore_event)
        submaps.run(opened, SubmapConfig(count=1), ignore_event)
        yield opened


class Killed(BaseException):
    """Takes the place of a kill in the middle of a stage."""


def test_every_frame_has_depth_and_the_floors_are_found_with_what_it_shows(project: Project) -> None:
    layout, count = project.layout, len(project.need_capture().frames)
    assert sorted(p.name for p in layout.depth.iterdir() if p.is_file()) == sorted(
        ["cloud.ply", "frames.json", *(f"{i:06d}{end}.png" for i in range(count) for end in ("", "_confidence"))]
    )
    scan = project.scan()
    assert project.need_capture().cloud is None
    assert scan is not None and scan.kind == "images" and scan.is_dense and len(scan.points) > 1000
    surface = project.surface(0)
    assert surface is not None
    heights = project.need_capture().positions[:, 2] - surface.height_at(project.need_capture().positions[:, :2])
    assert np.abs(heights - 1.3).max() < 0.1, "nobody said how high the cameras were"
    found = ledger.record(project, "depth")
    assert found is not None and found.summary["frames"] == count and found.summary["use"] == "auto"


def test_what_is_up_to_date_ends_at_once_and_other_settings_make_it_anew(project: Project) -> None:
    heard: list[Event] = []
    depths.run(project, "auto", replace(CONFIG, threads=1), heard.append)
    assert heard == [Log("The depth is up to date.", "depth")]
    before, trained = project.layout.depth, train_key(project, project.submaps()[0], TrainingConfig())
    assert "depth of 40 frames" in replaced_result_sentence(project, "depth")
    depths.run(project, "auto", replace(CONFIG, planes=48), ignore_event)
    assert project.layout.depth != before and before.is_dir(), "the old stays until it is replaced in turn"
    floors.run(project, heard.append)
    assert any(isinstance(e, Done) for e in heard), "floors depend on depth"
    assert train_key(project, project.submaps()[0], TrainingConfig()) != trained
    assert restore(project, "depth").startswith("the depth of 40 frames") and project.layout.depth == before


@pytest.mark.parametrize("step", [10, 60, 100, 140, 180])
def test_a_depth_that_is_killed_between_frames_goes_on_and_the_old_one_stays(project: Project, step: int) -> None:
    def killed(event: Event) -> None:
        if isinstance(event, Progress) and event.stage == "depth" and event.done >= step:
            raise Killed

    def found() -> dict[Path, int]:
        return {p: p.stat().st_mtime_ns for p in (*making.glob("*.png"), *making.glob("*/*.npz"))}

    before, config = project.scan(), replace(CONFIG, planes=48, threads=1)
    with pytest.raises(Killed):
        depths.run(project, "auto", config, killed)
    making = project.root / project.stage_results().made_at("depth")["depth"]
    done = found()
    assert len(done) >= step and project.scan() is before
    again: list[int] = []
    depths.run(project, "auto", config, lambda e: again.append(e.done) if isinstance(e, Progress) else None)
    assert project.layout.depth == making and project.scan() is not before
    assert sorted(again)[2] >= step, "what was done is not done again"
    assert not list(making.glob("*/*.npz")), "what was needed on the way is gone"


def test_damaged_files_are_one_sentence(project: Project, capsys: pytest.CaptureFixture[str]) -> None:
    truth = project.root.parent / "truth"
    truth.mkdir()
    shutil.copy(project.layout.depth / "000003.png", truth)
    (project.layout.depth / "000003.png").write_bytes(b"\x89PNG broken")
    assert main(["evaluate", "depth", "--project", str(project.root), "--truth", str(truth)]) == 2
    said = capsys.readouterr().err
    assert "000003.png" in said and "nvsim depth" in said and "Traceback" not in said
    (project.layout.depth / "cloud.ply").write_bytes(b"ply\n")
    project._scan = None
    with pytest.raises(InputError, match=r"cloud\.ply"):
        project.scan()
    depths.run(project, "auto", CONFIG, ignore_event)  # makes it again
    assert project.scan() is not None


def test_depth_is_scored_against_itself_and_against_the_building(
    project: Project, building: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = ["evaluate", "depth", "--json", "--project", str(project.root), "--truth"]
    assert main([*order, str(project.layout.depth)]) == 0
    itself = json.loads(capsys.readouterr().out)
    assert itself == {"within_2": 1.0, "within_5": 1.0, "within_10": 1.0, "covered": 1.0, "frames": 40}
    assert main([*order, str(building / "ground_truth" / "depth")]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["frames"] == 4 and 0.05 < figures["covered"] < 1 and figures["within_10"] > 0.6


def test_a_capture_with_a_scan_skips_it_in_no_time_and_says_so(
    scanned: Project, capsys: pytest.CaptureFixture[str]
) -> None:
    with_scan = scanned.scan()
    floors.run(scanned, ignore_event)
    floors_before = ledger.record(scanned, "floors")
    heard: list[Event] = []
    started = time.monotonic()
    depths.run(scanned, "auto", DepthConfig(), heard.append)
    assert time.monotonic() - started < 0.5
    assert [e.summary for e in heard if isinstance(e, Done)] == ["no depth is estimated: the capture has a LiDAR scan"]
    assert "depth" in scanned.stage_results().finished_stages and scanned.scan() is with_scan
    assert not scanned.layout.depth.exists() and kept_results(scanned) == ()
    heard.clear()
    depths.run(scanned, "auto", CONFIG, heard.append)
    assert heard == [Log("No depth is estimated: the capture has a LiDAR scan.", "depth")]
    floors.run(scanned, heard.append)
    assert ledger.record(scanned, "floors") == floors_before, "found before there was a depth stage, and still current"
    assert main(["evaluate", "depth", "--project", str(scanned.root), "--truth", str(scanned.root)]) == 2
    assert "as the capture has a LiDAR scan; run `nvsim depth --depth always" in capsys.readouterr().err
    imported.run(scanned, scanned.need_capture().source, CaptureConfig(scale=1.5), ignore_event)
    assert "depth" in outdated_stages(scanned)
    depths.run(scanned, "auto", CONFIG, ignore_event)
    assert "depth" not in outdated_stages(scanned) and kept_results(scanned)[0].stage == "import"
    assert [k.stage for k in kept_results(scanned)] == ["import"], "that nothing was done is not worth keeping"


def test_a_submap_trains_longer_where_the_images_alone_say_where_things_are(project: Project, scanned: Project) -> None:
    config = TrainingConfig(steps=300, scanless=ScanlessConfig(means=3.0, means_end=1.0))
    longer = adapt_to_capture(project, config)
    assert longer.steps == 600
    assert longer.rate == replace(config.rate, means=3 * config.rate.means)
    assert adapt_to_capture(scanned, config) == config
    same = ScanlessConfig(1.0, 1.0, 1.0)
    assert adapt_to_capture(project, replace(config, scanless=same)) == replace(config, scanless=same)
    submap = project.submaps()[0]
    assert train_key(project, submap, longer) == train_key(project, submap, replace(longer, scanless=same))


def test_always_fills_holes_of_a_scan_and_never_overrules_it(scanned: Project) -> None:
    scan = scanned.need_capture().cloud
    assert scan is not None
    middle = np.median(scan.points[:, 0])
    half = replace(scan, points=scan.points[scan.points[:, 0] < middle], colors=None)
    scanned._capture = (scanned._capture[0], replace(scanned.need_capture(), cloud=half)) if scanned._capture else None
    depths.run(scanned, "always", CONFIG, ignore_event)
    found = scanned.scan()
    assert found is not None and found.kind == "lidar" and found.colors is None and found.normals is not None
    assert np.array_equal(found.points[: len(half.points)], half.points)
    added = found.points[len(half.points) :]
    everything = read_cloud_file(scanned.layout.depth / "cloud.ply")
    assert 100 < len(added) < len(everything.points) and np.mean(added[:, 0] > middle) > 0.8
    from scipy.spatial import cKDTree

    assert cKDTree(half.points).query(added)[0].min() > 0.15


def test_never_takes_depth_out_of_use_and_restore_brings_it_back(project: Project) -> None:
    before = project.scan()
    assert before is not None
    depths.run(project, "never", CONFIG, ignore_event)
    assert project.scan() is None and [k.stage for k in kept_results(project)] == ["depth"]
    restore(project, "depth")
    again = project.scan()
    assert again is not None and np.array_equal(again.points, before.points)
    restore(project, "depth")
    assert project.scan() is None


def test_depth_of_another_capture_is_not_used(project: Project) -> None:
    assert project.scan() is not None
    imported.run(project, project.need_capture().source, CaptureConfig(scale=2.0), ignore_event)
    assert project.scan() is None and "depth" in outdated_stages(project)
    restore(project, "import")
    assert project.scan() is not None


def test_floors_without_scan_and_depth_warn(building: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capture = few_frames(tmp_path / "capture", building, 6, cloud=False)
    here = ["--project", str(tmp_path / "rooms.nvsim")]
    assert main(["import", str(capture), *here, "--camera-height", "1.2"]) == 0
    assert main(["submaps", *here]) == 0
    assert main(["floors", *here]) == 0
    assert "run `nvsim depth --project`" in capsys.readouterr().err
    assert main(["floors", *here]) == 0
    assert "up to date" in capsys.readouterr().err, "as are floors of before there was a depth stage"
    with Project.open(tmp_path / "rooms.nvsim") as opened:
        assert first_outdated_stage(outdated_stages(opened), opened.stage_results().stages_of_previous_cut) is None


def test_the_window_shows_the_cloud_of_the_images(project: Project) -> None:
    reader = ProjectReader(project.root)
    try:
        read = list(reader.updates())[-1]
    finally:
        reader.close()
    assert read.capture is not None and read.capture.cloud is None
    assert read.scan_cloud is not None and read.scan_cloud.kind == "images"
    assert read.dots is not None and read.dots.cloud is read.scan_cloud


def test_the_window_offers_depth_only_where_it_is_missing(project: Project, scanned: Project) -> None:
    walk, parts = project.need_capture(), project.submaps()
    begun: frozenset[StageName] = frozenset({"import", "submaps"})
    bare = Contents(project.root, walk, parts, stages=begun)
    assert bare.missing_verb == "depth" and bare.missing == "No depth is estimated yet."
    assert replace(bare, stages=begun | {"depth"}).missing_verb == "floors"
    assert replace(bare, stages=begun | {"floors"}).missing_verb == "train", "of before there was a depth stage"
    assert replace(bare, capture=scanned.need_capture()).missing_verb == "floors"


def test_a_skipped_depth_loads_nothing_heavy(scanned: Project) -> None:
    here = str(scanned.root)
    scanned.close()
    code = (
        "import sys; from nvsim.cli.main import main; "
        f"assert main(['depth', '--project', {here!r}]) == 0; "
        "print(*sorted({'torch', 'numba', 'cv2', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "" and "the capture has a LiDAR scan" in done.stderr
