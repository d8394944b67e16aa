"""Poses that the images contradict are adjusted when a capture is imported; others stay to the last bit."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from nvsim.building import BuildingConfig, generate
from nvsim.capture.images import read_image
from nvsim.capture.types import Capture
from nvsim.cli.main import main
from nvsim.events import Event, Log
from nvsim.poses import refinement
from nvsim.poses.refinement import median_epipolar_error, refine
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import imported
from tests.benchmarks.images_only import shake, without_scan


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A small building with its scan, without it, and without it as a hand would have left it."""
    folder = tmp_path_factory.mktemp("poses")
    config = BuildingConfig(seed=3, size="small", width=240, height=180, people=False)
    generate(folder, config)
    for name in ("plain", "shaken"):
        without_scan(folder / "capture", folder / name)
    shake(folder / "shaken")
    tree = json.loads((folder / "shaken" / "transforms.json").read_text())
    tree["ply_file_path"] = str(folder / "capture" / "points.ply")
    (folder / "shaken" / "with_scan.json").write_text(json.dumps(tree))
    return {"scanned": folder / "capture", "plain": folder / "plain", "shaken": folder / "shaken"}


def brought(folder: Path, source: Path, config: CaptureConfig | None = None) -> tuple[Capture, dict[str, object], str]:
    events: list[Event] = []
    with Project.create_or_open(folder) as project:
        capture = imported.run(project, source, config or CaptureConfig(), events.append)
        record = ledger.record(project, "import")
        assert record is not None
        np.testing.assert_array_equal(poses(project.need_capture()), poses(capture))
    return capture, record.summary, " ".join(e.text for e in events if isinstance(e, Log))


def poses(capture: Capture) -> NDArray[np.float64]:
    return np.stack([f.camera_to_world for f in capture.frames])


@pytest.fixture(scope="module")
def given(captures: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Capture, dict[str, object]]:
    """The capture with the poses as the hand left them, and the summary of its import."""
    folder = tmp_path_factory.mktemp("given") / "given"
    return brought(folder, captures["shaken"], CaptureConfig(poses="given"))[:2]


def steps_off(found: Capture, true: Capture) -> float:
    """Metres by which the step from one camera to the next is off, the median."""
    off = (poses(found) - poses(true))[:, :3, 3]
    return float(np.median(np.linalg.norm(np.diff(off, axis=0), axis=1)))


def test_poses_of_a_hand_are_adjusted_and_said_to_be(
    captures: dict[str, Path], given: tuple[Capture, dict[str, object]], tmp_path: Path
) -> None:
    true, summary, said = brought(tmp_path / "plain", captures["plain"])
    assert "poses_before_px" not in summary and "poses" not in said
    unchanged, summary = given
    assert "poses_before_px" not in summary
    found, summary, said = brought(tmp_path / "found", captures["shaken"])
    assert summary["poses_after_px"] < 0.7 * summary["poses_before_px"]  # type: ignore[operator]
    assert "The poses were adjusted" in said and "--poses given" in said
    assert steps_off(found, true) < 0.6 * steps_off(unchanged, true)
    assert [f.name for f in found.frames] == [f.name for f in unchanged.frames]


def test_poses_beside_a_scan_are_left_alone_unless_it_is_asked(captures: dict[str, Path], tmp_path: Path) -> None:
    _, summary, _ = brought(tmp_path / "auto", captures["shaken"] / "with_scan.json")
    assert "poses_before_px" not in summary
    _, summary, _ = brought(tmp_path / "asked", captures["shaken"] / "with_scan.json", CaptureConfig(poses="refined"))
    assert "poses_before_px" in summary


def test_depth_images_move_with_the_poses_of_their_frames(captures: dict[str, Path], tmp_path: Path) -> None:
    tree = json.loads((captures["shaken"] / "transforms.json").read_text())
    path = tmp_path / "depth.png"
    assert cv2.imwrite(str(path), np.full((45, 60), 2000, np.uint16))
    for frame in tree["frames"]:
        frame["depth_file_path"] = str(path)
    listed = captures["shaken"] / "with_depth.json"
    listed.write_text(json.dumps(tree))
    found, summary, said = brought(tmp_path / "found", listed)
    assert "poses_before_px" in summary and "The poses were adjusted" in said
    at = {f.name: f.camera_to_world for f in found.frames}
    assert len(found.depths) == len(found.frames)
    for depth in found.depths:
        np.testing.assert_allclose(depth.camera_to_world, at[depth.frame], atol=1e-9)


def test_the_check_says_that_poses_contradict_the_images(
    captures: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    said = {}
    for name, path in (*captures.items(), ("beside", captures["shaken"] / "with_scan.json")):
        assert main(["check", str(path)]) == 0
        said[name] = capsys.readouterr().out
    assert "the poses miss" not in said["plain"] + said["scanned"]
    assert "note: the poses miss" in said["shaken"] and "adjusted when it is imported" in said["shaken"]
    assert "warning: the poses miss" in said["beside"] and "`nvsim run --poses refined`" in said["beside"]


def test_an_image_that_is_missing_is_no_matter_of_poses(
    given: tuple[Capture, dict[str, object]], tmp_path: Path
) -> None:
    missing, some = tmp_path / "nowhere.jpg", given[0].frames[:40]
    frames = [f if i else type(f)(f.name, missing, f.lens, f.camera_to_world) for i, f in enumerate(some)]
    found = refine(frames)
    assert found is not None
    np.testing.assert_allclose(found.frames[0].camera_to_world, frames[0].camera_to_world, atol=1e-12)
    assert median_epipolar_error(frames[:1]) is None and refine(frames[:1]) is None and refine([]) is None


def test_who_interrupts_does_not_wait_for_all_images(
    given: tuple[Capture, dict[str, object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = given[0].frames
    read: list[object] = []
    monkeypatch.setattr(refinement, "read_image", lambda frame, size: (read.append(frame), read_image(frame, size))[1])

    def interrupt(done: int, of: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        refine(frames * 10, interrupt)
    assert len(read) < 5 * len(frames)


def test_what_was_asked_counts_in_the_key_only_where_it_is_not_the_usual(tmp_path: Path) -> None:
    assert "poses" not in CaptureConfig().key["CaptureConfig"]
    assert CaptureConfig(poses="given").key["CaptureConfig"]["poses"] == "given"


@pytest.mark.data
def test_a_real_office_agrees_better_with_itself(shared_data: Path, tmp_path: Path) -> None:
    without_scan(shared_data / "office_walk", tmp_path / "office")
    path = tmp_path / "office" / "transforms.json"
    tree = json.loads(path.read_text())
    path.write_text(json.dumps({**tree, "frames": tree["frames"][:25]}))
    with Project.create_or_open(tmp_path / "office.nvsim") as project:
        capture = imported.run(
            project, tmp_path / "office", CaptureConfig(scale=1.0, poses="given"), lambda event: None
        )
    given, found = median_epipolar_error(capture.frames), refine(capture.frames)
    assert given is not None and found is not None
    after = median_epipolar_error(found.frames)
    assert after is not None and after < 0.7 * given and found.meters < 0.05
