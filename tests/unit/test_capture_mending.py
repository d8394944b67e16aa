"""The data check lists the content of a capture, reports equal problems once, and names the fix."""

from __future__ import annotations

import json
from pathlib import Path

import capture_samples as sample
import numpy as np
import pytest

from nvsim.capture.check import check
from nvsim.capture.excluded_frames import expand_list, write_names
from nvsim.capture.findings import Finding, grouped
from nvsim.capture.read import read
from nvsim.cli.main import main
from nvsim.errors import InputError


def test_a_capture_is_summed_up_in_figures_that_were_put_into_it(tmp_path: Path) -> None:
    poses = sample.walk(30)
    found = check(sample.write_nerfstudio(tmp_path, poses, sample.room())).summary
    assert found is not None and (found.images, found.cameras, found.sizes) == (30, 1, ((64, 48, 30),))
    assert found.points == len(sample.room()) and found.cloud == "lidar" and found.scale_known
    assert np.allclose(found.paths, [poses[:, :2, 3]], atol=1e-3) and found.faulty == ()
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert found.length == pytest.approx(steps.sum(), abs=0.01)
    assert check(tmp_path / "nowhere").summary is None
    sample.write_nerfstudio(tmp_path / "second", sample.walk(8), sample.room())
    (tmp_path / "both.captures").write_text(f"{tmp_path}\n{tmp_path / 'second'}\n")
    both = check(tmp_path / "both.captures").summary
    assert both is not None and [len(path) for path in both.paths] == [30, 8] and both.cameras == 2


def test_identical_findings_are_one_line_with_their_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(20), sample.room())
    for i in range(9):
        (tmp_path / "images" / f"{i:03d}.png").unlink()
    assert main(["check", str(path)]) == 2
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("error")] == [lines[1]]
    assert "the image is missing, 9 times" in lines[1] and "and 6 more" in lines[1] and "images/003.png" not in lines[1]
    assert lines[0].startswith("20 images of 1 camera; 64 x 48 pixels; ")
    assert main(["check", str(path), "--places"]) == 2
    assert "images/008.png" in capsys.readouterr().out
    main(["check", str(sample.write_nerfstudio(tmp_path / "one", sample.walk(1), sample.room()))])
    assert capsys.readouterr().out.startswith("1 image of 1 camera; ")
    kinds = grouped([Finding("note", "m", str(i), f"c{i}", (f"f{i}",)) for i in range(3)])
    assert [(k.places, k.frames, k.consequence) for k in kinds] == [(("0", "1", "2"), ("f0", "f1", "f2"), "c0")]


def test_frames_with_errors_are_listed_in_a_file_and_left_out_by_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(20), sample.room())
    names = tuple(f"images/{i:03d}.png" for i in (2, 3, 11))
    for name in names:
        (tmp_path / name).write_bytes(b"")
    report = check(path)
    assert report.bad_frames == names and report.summary is not None and len(report.summary.faulty) == 3
    listed = tmp_path / "bad.txt"
    assert main(["check", str(path), "--bad-frames", str(listed)]) == 2
    assert listed.read_text().splitlines() == list(names) and f"--leave-out @{listed}" in capsys.readouterr().out
    assert main(["check", str(path), "--leave-out", f"@{listed}"]) == 0
    project = tmp_path / "mended.nvsim"
    assert main(["import", str(path), "--project", str(project), "--leave-out", f"@{listed}"]) == 0
    listed.unlink()  # the project has the names themselves
    stored = json.loads((next(project.rglob("capture.json"))).read_text())
    assert len(stored["frames"]) == 17 and not set(names) & {f["name"] for f in stored["frames"]}
    assert main(["import", str(path), "--project", str(project), "--leave-out", ",".join(names)]) == 0
    assert "unchanged" in capsys.readouterr().err
    assert main(["check", str(path), "--leave-out", f"@{listed}"]) == 2
    with pytest.raises(InputError, match="line breaks"):
        write_names(["a\nb"], listed)
    assert expand_list("a,b") == "a,b"


@pytest.mark.parametrize("depth", [0, 1])
def test_images_are_found_in_the_folder_that_is_named(tmp_path: Path, depth: int) -> None:
    path = sample.write_nerfstudio(tmp_path / "walk", sample.walk(8), sample.room())
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "walk" / "images").rename(elsewhere / "images")
    folder = elsewhere / "images" if depth == 0 else elsewhere
    assert check(path).refused and not check(path, images=str(folder)).refused
    frames = read(path, images=str(folder)).frames
    assert [f.image_path for f in frames] == [elsewhere / "images" / f"{i:03d}.png" for i in range(8)]
    assert "is not a folder" in check(path, images=str(tmp_path / "nowhere")).findings[0].message


def test_one_image_is_never_given_to_two_frames(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(8), sample.room())
    tree = json.loads(path.read_text())
    tree["frames"][0]["file_path"], tree["frames"][1]["file_path"] = "left/x.png", "right/x.png"
    path.write_text(json.dumps(tree))
    (tmp_path / "pool").mkdir()
    (tmp_path / "images" / "000.png").rename(tmp_path / "pool" / "x.png")
    with pytest.raises(InputError, match=r"left/x\.png and of right/x\.png"):
        read(path, images=str(tmp_path / "pool"))
