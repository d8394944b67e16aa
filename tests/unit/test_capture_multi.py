"""Several captures in one world are read as one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from capture_samples import room, walk, write_colmap, write_nerfstudio

from nvsim.capture.check import check
from nvsim.capture.multi_capture import write_list
from nvsim.capture.read import read
from nvsim.capture.trajectories import trajectories
from nvsim.errors import InputError


@pytest.fixture
def walks(tmp_path: Path) -> list[Path]:
    points = room()
    first, second = walk(seed=0), walk(count=7, seed=1)
    write_nerfstudio(tmp_path / "one", first, points, unit="meter")
    write_nerfstudio(tmp_path / "two", second, points[:100], unit="meter")
    return [tmp_path / "one", tmp_path / "two"]


def test_frames_and_points_of_all_are_there_in_one_frame_of_reference(walks: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "both.captures"
    write_list(walks, path)
    alone = [read(w, camera_height=1.4) for w in walks]
    both = read(path, camera_height=1.4)
    assert len(both.frames) == len(alone[0].frames) + len(alone[1].frames)
    assert both.cloud is not None and alone[0].cloud is not None and alone[1].cloud is not None
    assert len(both.cloud.points) == len(alone[0].cloud.points) + len(alone[1].cloud.points)
    names = [f.name for f in both.frames]
    assert len(set(names)) == len(names) and {n.split("/")[0] for n in names} == {"one", "two"}
    # Distances within the first walk are what they were, and so is the place of the second beside it.
    of_first = both.positions[: len(alone[0].frames)]
    np.testing.assert_allclose(np.diff(of_first, axis=0), np.diff(alone[0].positions, axis=0), atol=0.02)


def test_each_capture_of_a_list_has_its_own_trajectory(walks: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "both.captures"
    write_list(walks, path)
    both = read(path, camera_height=1.4)
    assert [len(t) for t in trajectories(both)] == [12, 7]
    assert [len(t) for t in trajectories(replace(both, format="other words"))] == [12, 7]
    assert len(trajectories(replace(both, source=walks[0], format="several words"))) == 1


def test_paths_may_be_relative_and_lines_have_remarks(walks: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "both.captures"
    path.write_text("# two walks\none  # in spring\n\ntwo\n")
    assert len(read(path, camera_height=1.4).frames) == 19


def test_the_check_names_the_capture_that_is_wrong(walks: list[Path], tmp_path: Path) -> None:
    image = next((walks[1] / "images").iterdir())
    image.unlink()
    path = tmp_path / "both.captures"
    write_list(walks, path)
    report = check(path, camera_height=1.4)
    assert report.refused and any(f.where.startswith("two, ") for f in report.findings if f.severity == "error")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "names no capture"),
        ("one\none\n", "twice"),
        ("one\nmissing\n", "does not exist"),
        ("both.captures\n", "itself a list"),
    ],
)
def test_a_list_that_cannot_be_used_is_refused_in_one_sentence(
    walks: list[Path], tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "both.captures"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read(path)


def test_captures_in_different_units_are_not_mixed(walks: list[Path], tmp_path: Path) -> None:
    write_colmap(tmp_path / "three", walk(), room(), binary=False)
    path = tmp_path / "both.captures"
    write_list([walks[0], tmp_path / "three"], path)
    with pytest.raises(InputError, match="not in one unit"):
        read(path, camera_height=1.4)
