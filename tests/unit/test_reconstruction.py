"""From a video to a capture: file types, poses, interruptions, and refused input."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from filmed_room import filmed_path, write_video

from nvsim.capture.read import read
from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.files.opening import read_bytes
from nvsim.footage.sources import find_footage
from nvsim.project.project import Project
from nvsim.project.stages import added_captures, posed
from nvsim.project.stages.imported import capture_config
from nvsim.reconstruction import computing
from nvsim.reconstruction.footage_check import footage_at
from nvsim.reconstruction.report import (
    SETTINGS,
    PosesReport,
    WeakPlace,
    read_report,
    report_beside,
    rows,
    stamp_of,
    write_report,
)


@dataclasses.dataclass(frozen=True)
class Filmed:
    """video, folder: of the poses; kept: images that the killed run left, with their times of change; said: by the run
    that finished."""

    video: Path
    folder: Path
    kept: dict[str, int]
    said: str


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Filmed:
    """Poses that one run began, `kill -9` ended, and a second run finished."""
    root = tmp_path_factory.mktemp("filmed")
    video, folder = write_video(root / "walk.mp4"), root / "house"
    command = [sys.executable, "-m", "nvsim", "poses", str(video), "--out", str(folder)]
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 120
    while not (folder / "images" / "frames.json").exists():
        assert time.monotonic() < end and first.poll() is None
        time.sleep(0.02)
    children = psutil.Process(first.pid).children()
    first.kill()
    first.wait()
    assert children and not psutil.wait_procs(children, 20)[1]
    assert not (folder / "poses.json").exists() and not (folder / "sparse").exists()
    kept = {p.name: p.stat().st_mtime_ns for p in (folder / "images").glob("*.jpg")}
    second = subprocess.run(command, capture_output=True, text=True)
    assert second.returncode == 0, second.stderr
    return Filmed(video, folder, kept, second.stderr)


def report_of(video: Path, **changes: object) -> PosesReport:
    footage = find_footage(video)
    assert footage is not None
    counts = 40, 20, 1, 18, (18, 1)  # decoded, chosen, blurred, with a pose, pieces
    whole = PosesReport(
        str(video), "a video", stamp_of(footage), SETTINGS, *counts, (210.0,), (320, 240), 0.5, 3, ("a.jpg",), 2.0
    )
    return dataclasses.replace(whole, **changes)  # type: ignore[arg-type]


# What is a video ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "path", "is_footage"),
    [
        (["walk.mp4"], "walk.mp4", True),
        (["walk.MOV"], "walk.MOV", True),
        (["walk.mp4", "second.mov", "note.txt"], "", True),
        (["walk.mp4", "1.jpg", "2.jpg", "3.jpg"], "", True),
        (["walk.mp4", "house.nvsim/project.db", "house.nvsim/poses/sparse/0/cameras.bin",
          "house.nvsim/poses/sparse/0/images.bin"], "", True),
        (["walk.mp4", ".poses/mapped/0/cameras.bin", ".poses/mapped/0/images.bin"], "", True),
        (["walk.mp4", "transforms.json"], "", False),
        (["walk.mp4", "sparse/0/cameras.bin", "sparse/0/images.bin"], "", False),
        (["walk.mp4", "sensors/sensors.txt"], "", False),
        (["walk.mp4", "scan/transforms.json"], "", False),
        (["walk.mp4", "sparse/0/images.bin"], "", False),  # a capture that lacks a file
        (["walk.mp4", "keyframes/images/1.jpg"], "", False),  # an export of Polycam
        (["walk.mp4", "transforms.json"], "transforms.json", False),
        (["1.jpg", "2.jpg", "3.jpg"], "", True),  # photographs
        (["1.jpg", "2.jpg"], "", False),
        (["videos/walk.mp4"], "", False),
        ([], "gone.mp4", False),
    ],
)  # fmt: skip
def test_a_video_beside_a_capture_is_no_video_capture(
    tmp_path: Path, names: list[str], path: str, is_footage: bool
) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("{}" if name.endswith("json") else "x")
    assert (footage_at(tmp_path / path) is not None) == is_footage


@pytest.mark.parametrize("content", [b"", b"only words, and no video\n" * 50])
def test_a_file_that_is_no_video_is_one_sentence(tmp_path: Path, content: bytes, capfd: pytest.CaptureFixture) -> None:
    video = tmp_path / "walk.mp4"
    video.write_bytes(content)
    out, project = tmp_path / "out", tmp_path / "house.nvsim"
    reason = "cannot be decoded" if content else "is empty"
    for command in (
        ["poses", str(video), "--out", str(out)],
        ["import", str(video), "--project", str(project), "--camera-height", "1.4"],
    ):
        assert main(command) == 2
        said = [line for line in capfd.readouterr().err.splitlines() if "%" not in line]
        assert len(said) == 1 and reason in said[0], said
    assert main(["check", str(video)]) == 2
    told = capfd.readouterr()
    assert reason in told.out and told.err == ""
    assert [p.name for p in tmp_path.iterdir()] == ["walk.mp4"]


def test_a_list_of_videos_and_a_360_degree_video_are_explained(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for name in ("a.mp4", "b.mp4", "round.insv"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "two.captures").write_text("a.mp4\nb.mp4\n")
    for name, said in (("two.captures", "put all of them"), ("round.insv", "360 degree video")):
        assert main(["check", str(tmp_path / name)]) == 2
        assert said in capsys.readouterr().out


def test_check_says_what_a_video_is(filmed: Filmed, capsys: pytest.CaptureFixture) -> None:
    assert main(["check", str(filmed.video)]) == 0
    said = capsys.readouterr().out
    assert "30 frames, 3.0 s, 10 frames per second, 320 x 240 pixels" in said and "can be decoded" in said
    assert "--camera-height" in said
    assert main(["check", str(filmed.video), "--camera-height", "1.5", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["videos"][0]["frames"] == 30 and not told["refused"]
    assert all(f["message"] != "the scale is unknown" for f in told["findings"])


# The poses ------------------------------------------------------------------------------------------------------------


def test_the_poses_of_a_video_are_those_it_was_filmed_from(filmed: Filmed) -> None:
    report = read_report(filmed.folder)
    assert report is not None and report.usable and report.looked_at == 30
    assert report.with_pose + len(report.left_out) == report.frames
    assert report_beside(filmed.folder / "sparse" / "0") == report
    capture = read(filmed.folder, scale=1.0)
    assert len(capture.frames) == report.with_pose
    assert not (filmed.folder / ".poses").exists()
    # A similarity is all that lies between poses of a video and the true ones.
    truth = filmed_path()[[int(f.name.removesuffix(".jpg").split("_")[-1]) for f in capture.frames], :3, 3]
    found = capture.positions
    a, b = truth - truth.mean(axis=0), found - found.mean(axis=0)
    u, s, vt = np.linalg.svd(a.T @ b)
    s[2] *= np.linalg.det(u @ vt)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    off = np.linalg.norm(a - (s.sum() / (b**2).sum()) * b @ turn.T, axis=1)
    assert off.max() < 0.1, off  # meters, of a path of 3 m


def test_a_killed_run_continues_with_its_frames(filmed: Filmed) -> None:
    now = {p.name: p.stat().st_mtime_ns for p in (filmed.folder / "images").glob("*.jpg")}
    assert filmed.kept == now and len(now) > 5
    assert "poses of all frames" in filmed.said or "frames have a pose" in filmed.said


def test_finished_poses_are_used_again_without_computing(filmed: Filmed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(computing, "_computed_in_child", lambda *_: pytest.fail("computed again"))
    before = read_bytes(filmed.folder / "poses.json")
    assert main(["poses", str(filmed.video), "--out", str(filmed.folder)]) == 0
    assert read_bytes(filmed.folder / "poses.json") == before


def test_a_folder_of_other_files_is_refused_and_left_alone(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    other = tmp_path / "other.mp4"
    shutil.copy(filmed.video, other)
    assert main(["poses", str(other), "--out", str(filmed.folder)]) == 2
    assert f"contains the poses of {filmed.video}" in capsys.readouterr().err
    (tmp_path / "mine" / "images").mkdir(parents=True)
    assert main(["poses", str(other), "--out", str(tmp_path / "mine")]) == 2
    assert "contains another capture (images)" in capsys.readouterr().err


def test_too_few_poses_are_refused_at_once_with_advice(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    write_report(report_of(filmed.video, with_pose=7, pieces=(7, 6)), tmp_path)
    assert main(["poses", str(filmed.video), "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "Only 7 of 20 frames" in said and "film more slowly" in said and "--model" not in said


def test_ctrl_c_ends_the_computation_at_once(filmed: Filmed, tmp_path: Path) -> None:
    shutil.copytree(filmed.folder / "images", tmp_path / "images")
    (tmp_path / ".poses").mkdir()
    footage = find_footage(filmed.video)
    assert footage is not None
    begun = {"stamp": stamp_of(footage), "settings": SETTINGS}
    (tmp_path / ".poses" / "begun.json").write_text(json.dumps(begun))
    command = [sys.executable, "-m", "nvsim", "poses", str(filmed.video), "--out", str(tmp_path), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    for line in process.stdout:
        if "find features" in line:
            break
    (child,) = psutil.Process(process.pid).children()
    os.kill(process.pid, signal.SIGINT)
    process.stdout.read()
    assert process.wait(60) == 130 and not psutil.wait_procs([child], 20)[1]
    assert not (tmp_path / "poses.json").exists() and (tmp_path / ".poses" / "begun.json").exists()


# The report -----------------------------------------------------------------------------------------------------------


def test_a_report_is_read_as_it_was_written_and_damaged_ones_are_refused(filmed: Filmed, tmp_path: Path) -> None:
    place = WeakPlace("a.jpg", "b.jpg", (1.0, 2.5), "the frames are blurred", "move more slowly here")
    report = report_of(filmed.video, members=(("a.jpg", "b.jpg"), ("c.jpg",)), weak=(place,))
    write_report(report, tmp_path)
    assert read_report(tmp_path) == report
    older = {k: v for k, v in json.loads((tmp_path / "poses.json").read_text()).items() if k not in ("members", "weak")}
    (tmp_path / "poses.json").write_text(json.dumps(older))
    assert read_report(tmp_path) == dataclasses.replace(report, members=(), weak=())
    tree = json.loads((tmp_path / "poses.json").read_text())
    for name, value in (
        ("weak", [{"first": 3}]),
        ("members", 1),
        ("loops", -1),
        ("pieces", "many"),
        ("residual_px", 1e999),
        ("left_out", [3]),
        ("stamp", [[1]]),
    ):
        (tmp_path / "poses.json").write_text(json.dumps({**tree, name: value}))
        with pytest.raises(InputError, match="poses.json"):
            read_report(tmp_path)
    assert read_report(tmp_path / "elsewhere") is None


def test_the_report_in_words_names_weak_places(filmed: Filmed) -> None:
    place = WeakPlace("a.jpg", "b.jpg", (61.9, 64.0), "the frames are blurred", "move more slowly here")
    words = rows(report_of(filmed.video, weak=(place,) * 10))
    said = "1:01 to 1:04 (a.jpg to b.jpg): the frames are blurred. When you film again: move more slowly here."
    assert words["Weak place 1"] == said and "2; poses.json" in words["More weak places"]


def test_the_report_in_words_names_what_is_missing(filmed: Filmed) -> None:
    words = rows(report_of(filmed.video, loops=0))
    assert words["Frames with a pose"] == "18 of 20 (90 %)"
    assert words["Frames without a pose"].endswith("a.jpg") and "never returns" in words["Loops"]
    assert "Frames without a pose" not in rows(report_of(filmed.video, left_out=(), pieces=(20,)))


# In a project ---------------------------------------------------------------------------------------------------------


def test_a_video_is_imported_through_its_poses(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "house.nvsim"
    shutil.copytree(filmed.folder, root / "poses")
    monkeypatch.setattr(computing, "_computed_in_child", lambda *_: pytest.fail("computed again"))
    arguments = ["import", str(filmed.video), "--project", str(root), "--camera-height", "1.4"]
    assert main(arguments) == 0
    capsys.readouterr()
    assert main(arguments) == 0
    assert "The capture is unchanged" in capsys.readouterr().err
    with Project.open(root, writable=True) as project:
        capture = project.need_capture()
        report = read_report(root / "poses")
        assert report is not None and len(capture.frames) == report.with_pose and capture.alignment.scale_known
        assert report_beside(capture.source) == report and report.source == str(filmed.video)
        with pytest.raises(InputError, match="is a video"):
            added_captures.run(project, filmed.video, lambda event: None)
        same, other = find_footage(filmed.video), find_footage(Path(shutil.copy(filmed.video, tmp_path / "walk.mp4")))
        assert same is not None and other is not None
        assert posed._folder_for(project, lambda at: computing.is_finished(at, same)) == root / "poses"
        beside = posed._folder_for(project, lambda at: computing.is_finished(at, other))
        assert beside == root / "poses-2"  # what is in use stays


def test_a_video_without_a_scale_is_imported_in_camera_heights(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    root = tmp_path / "house.nvsim"
    shutil.copytree(filmed.folder, root / "poses")
    arguments = ["import", str(filmed.video), "--project", str(root)]
    assert main(["check", str(root / "poses")]) == 0
    assert "the scale is assumed from a camera height of 1.5 m" in capsys.readouterr().out
    assert main(arguments) == 0
    assert "lengths are in camera heights of 1.5 m; set --camera-height" in capsys.readouterr().err
    with Project.open(root) as project:
        assumed = project.need_capture()
    assert not assumed.alignment.scale_known
    assert main([*arguments, "--camera-height", "1.5"]) == 0  # the same scale, and now it is known
    with Project.open(root) as project:
        known = project.need_capture()
    assert known.alignment.scale_known and known.alignment.scale == assumed.alignment.scale


def test_a_camera_height_is_kept_when_the_video_is_imported_again(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    root = tmp_path / "house.nvsim"
    shutil.copytree(filmed.folder, root / "poses")
    arguments = ["import", str(filmed.video), "--project", str(root)]
    assert main([*arguments, "--camera-height", "1.2"]) == 0
    with Project.open(root) as project:
        first = project.need_capture()
    assert main(arguments) == 0
    said = capsys.readouterr().err
    assert "camera height of the last import, 1.2 m, is kept" in said and "The capture is unchanged" in said
    assert main([*arguments, "--leave-out", first.frames[0].name]) == 0
    with Project.open(root) as project:
        again = project.need_capture()
    assert len(again.frames) == len(first.frames) - 1
    assert again.alignment.scale_known and again.alignment.scale == pytest.approx(first.alignment.scale, rel=0.02)


def test_the_distance_between_two_cameras_gives_the_scale(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    root = tmp_path / "house.nvsim"
    shutil.copytree(filmed.folder, root / "poses")
    names = [f.name for f in read(filmed.folder, scale=1.0).frames]
    arguments = ["import", str(filmed.video), "--project", str(root)]
    assert main([*arguments, "--known-length", f"{names[0]}, {names[-1]},2.5"]) == 0
    with Project.open(root) as project:
        capture = project.need_capture()
        assert capture.alignment.scale_known
        assert np.linalg.norm(capture.positions[-1] - capture.positions[0]) == pytest.approx(2.5)
        assert capture_config(project).scale == pytest.approx(capture.alignment.scale)
    for text, said in (
        (f"{names[0]},2.5", "not a length between two images"),
        (f"{names[0]},gone.jpg,2.5", "'gone.jpg', which is not an image with a pose"),
        (f"{names[0]},{names[0]},2.5", "at the same place"),
        (f"{names[0]},{names[1]},-1", "not a length between two images"),
    ):
        assert main([*arguments, "--known-length", text]) == 2
        assert said in capsys.readouterr().err
    assert main([*arguments, "--known-length", f"{names[0]},{names[1]},2", "--scale", "2"]) == 2
    assert "leave out one of them" in capsys.readouterr().err


def test_a_log_of_arkit_gives_the_scale_unless_the_user_does(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(computing, "_computed_in_child", lambda *_: pytest.fail("computed again"))
    root, log = tmp_path / "house.nvsim", filmed.video.with_name("odometry.csv")
    shutil.copytree(filmed.folder, root / "poses")
    rows = [f"{k / 10}, {k:06d}, {x}, {z}, {-y}, 0, 0, 0, 1" for k, (x, y, z) in enumerate(filmed_path()[:, :3, 3])]
    arguments = ["import", str(filmed.video), "--project", str(root)]
    try:
        log.write_text("\n".join(["timestamp, frame, x, y, z, qx, qy, qz, qw", *rows]))
        assert main(["check", str(filmed.video)]) == 0
        said = capsys.readouterr().out
        assert "ARKit recorded the positions of the camera: odometry.csv: 30 positions" in said
        assert "assumed" not in said and "--project NAME.nvsim`" in said
        assert main(arguments) == 0
        said = capsys.readouterr().err
        assert "Measured scale: " in said and "the ARKit log odometry.csv" in said and "camera heights" not in said
        with Project.open(root) as project:
            capture = project.need_capture()
        assert capture.alignment.scale_known
        true = filmed_path()[[int(f.name.removesuffix(".jpg").split("_")[-1]) for f in capture.frames], :3, 3]
        distance, wanted = (np.linalg.norm(p[-1] - p[0]) for p in (capture.positions, true))
        assert distance == pytest.approx(wanted, rel=0.03)
        assert main(["check", str(root / "poses")]) == 0
        said = capsys.readouterr().out
        assert "note: the scale is measured" in said and "standard deviation of 2" in said and "assumed" not in said
        scale = capture.alignment.scale
        assert main([*arguments, "--scale", str(1.3 * scale)]) == 0
        assert "30 % apart" in capsys.readouterr().err
        with Project.open(root) as project:
            assert project.need_capture().alignment.scale == pytest.approx(1.3 * scale)
        assert main(["check", str(root / "poses"), "--scale", str(1.3 * scale)]) == 0
        assert "warning: With your scale" in capsys.readouterr().out
        assert main([*arguments, "--scale", str(1.05 * scale)]) == 0
        assert "apart" not in capsys.readouterr().err
        log.write_text("timestamp, frame\n1, 2\n")
        assert main(["check", str(filmed.video)]) == 0
        assert "lacks the column x" in capsys.readouterr().out
        assert main(arguments) == 0
        said = capsys.readouterr().err
        assert "Measured scale: none from a position log" in said and "camera heights" in said
    finally:
        log.unlink(missing_ok=True)


def test_one_of_several_pieces_is_imported_if_the_user_names_it(
    filmed: Filmed, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(computing, "_computed_in_child", lambda *_: pytest.fail("computed again"))
    root = tmp_path / "house.nvsim"
    shutil.copytree(filmed.folder, root / "poses")
    shutil.copytree(filmed.folder / "sparse" / "0", root / "poses" / "sparse" / "1")
    report = read_report(filmed.folder)
    assert report is not None and report.models == 1 and report.members[0][0].endswith(".jpg")
    write_report(dataclasses.replace(report, frames=50, pieces=(report.with_pose, 9)), root / "poses")
    arguments = ["import", str(filmed.video), "--project", str(root), "--camera-height", "1.4"]
    assert main(arguments) == 2
    assert "or continue with one piece by --model 0 or --model 1" in capsys.readouterr().err
    assert main([*arguments, "--model", "1"]) == 0
    with Project.open(root) as project:
        assert project.need_capture().source == root / "poses" / "sparse" / "1"
        assert capture_config(project).model == "1"


def test_the_command_line_starts_without_the_library_for_poses() -> None:
    program = "import sys, nvsim.cli.commands.capture, nvsim.project.stages.posed\nsys.exit('pycolmap' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0


def test_poses_in_camera_heights_tell_the_scale(tmp_path: Path) -> None:
    (tmp_path / "walk.mp4").write_bytes(b"x")
    report, folder = report_of(tmp_path / "walk.mp4", upright=(True, False)), tmp_path / "house"
    assert all(report.scale_for(1.4, folder, model) == 1.4 for model in ("", "0", "sparse/0"))
    assert all(report.scale_for(1.4, folder, model) is None for model in ("1", "sparse/1", "7"))
    assert report.scale_for(1.4, folder / "sparse" / "0") == 1.4
    assert report.scale_for(1.4, folder / "sparse" / "1") is None
    assert report.scale_for(None, folder) is None
    write_report(report, tmp_path)
    again = read_report(tmp_path)
    assert again is not None and again.upright == (True, False)


@pytest.mark.parametrize(
    "text", ['{"0": [[1, 0], [0, 1]]}', "[]", "", "0 1 0 0", '{"sources": 1}', '{"a": {"source": 1}}']
)
def test_poses_of_another_program_are_no_report(text: str, tmp_path: Path) -> None:
    (tmp_path / "poses.json").write_text(text)
    assert report_beside(tmp_path) is None
    assert report_beside(tmp_path / "colmap" / "sparse" / "0") is None
