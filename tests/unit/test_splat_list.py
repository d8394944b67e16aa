"""Several splat files of one building, listed with their transforms."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from splat_rooms import any_rotation, joined, moved, stair_house, two_rooms

from nvsim.errors import InputError
from nvsim.project.stages.imported_splats import _fingerprint
from nvsim.scene_import.scene import align_scene
from nvsim.splats.formats.choice import read_splats, recognize, source_up_axis, write_splats
from nvsim.splats.formats.splat_list import listed_splats
from nvsim.splats.types import Gaussians


def chosen(g: Gaussians, rows: np.ndarray) -> Gaussians:
    return Gaussians(*(array[rows] for array in vars(g).values()))


def write_part(path: Path, g: Gaussians, rotation: np.ndarray, scale: float, shift: np.ndarray) -> str:
    """Writes `g` in a frame of its own, and returns its line in a list."""
    own = moved(g, rotation.T, 1 / scale)
    own.means[:] -= (rotation.T @ shift / scale).astype(np.float32)
    write_splats(path, own, False, "ply")
    rows = np.column_stack([scale * rotation, shift])
    return " ".join([path.name, *(f"{value:.9g}" for value in rows.ravel())])


def test_files_in_their_own_frames_become_the_whole_building(tmp_path: Path) -> None:
    house = stair_house()
    upper = house.means[:, 2] > 2.85
    shift = np.array([3.0, -2.0, 1.0])
    lines = [
        write_part(tmp_path / "ground floor.ply", chosen(house, ~upper), np.eye(3), 1.0, np.zeros(3)),
        write_part(tmp_path / "upper.ply", chosen(house, upper), any_rotation(3), 0.4, shift) + " 0 0 0 1  # scaled",
    ]
    (tmp_path / "house.splats").write_text("# two storeys\n\n" + "\n".join(lines))
    found = read_splats(tmp_path / "house.splats").gaussians
    expected = joined(chosen(house, ~upper), chosen(house, upper))
    np.testing.assert_allclose(found.means, expected.means, atol=1e-4)
    np.testing.assert_allclose(found.log_scales, expected.log_scales, atol=1e-4)
    assert (np.abs((found.quats * expected.quats).sum(axis=1)) > 0.9999).all()
    scene = align_scene("house.splats", found, "-y", up="z", scale=1.0)
    assert [level.height for level in scene.storeys.levels] == pytest.approx([0.0, 3.0], abs=0.02)


def test_files_with_colors_of_different_degrees_are_joined(tmp_path: Path) -> None:
    plain = chosen(two_rooms(), np.arange(50))
    rich = Gaussians(*vars(plain).values())
    rich.sh = np.concatenate([plain.sh, np.full((50, 3, 3), 0.1, np.float32)], axis=1)
    write_splats(tmp_path / "plain.ply", plain, False, "ply")
    write_splats(tmp_path / "rich.ply", rich, False, "ply")
    (tmp_path / "both.splats").write_text("plain.ply\nrich.ply\n")
    sh = read_splats(tmp_path / "both.splats").gaussians.sh
    assert sh.shape == (100, 4, 3) and (sh[:50, 1:] == 0).all() and np.allclose(sh[50:], rich.sh, atol=1e-5)


def test_a_list_has_the_kind_and_the_up_axis_of_its_first_file(tmp_path: Path) -> None:
    g = chosen(two_rooms(), np.arange(50))
    write_splats(tmp_path / "a.ply", g, True, "ply")
    (tmp_path / "a.splats").write_text("a.ply\n")
    assert recognize(tmp_path / "a.splats") == "ply"
    assert source_up_axis(tmp_path / "a.splats") == source_up_axis(tmp_path / "a.ply") == "z"


def test_a_changed_file_of_a_list_is_imported_again(tmp_path: Path) -> None:
    write_splats(tmp_path / "a.ply", chosen(two_rooms(), np.arange(50)), False, "ply")
    (tmp_path / "a.splats").write_text("a.ply\n")
    before = _fingerprint(tmp_path / "a.splats")
    assert before == _fingerprint(tmp_path / "a.splats")
    os.utime(tmp_path / "a.ply", ns=(1, 1))
    assert before != _fingerprint(tmp_path / "a.splats")


EYE = "1 0 0 0 0 1 0 0 0 0 1 0"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "names no splat file"),
        ("a.ply 1 0 0", "line 1 does not have 12 or 16 numbers"),
        (f"a.ply\nb.ply {EYE} 0 0 0 2", "line 2: .* not a rotation with a uniform scale"),
        ("a.ply -1 0 0 0 0 1 0 0 0 0 1 0", "line 1: .*mirror image"),
        ("a.ply 0 0 0 0 0 0 0 0 0 0 0 0", "line 1: .*no positive scale"),
        ("a.ply 1 0 0 0 0 2 0 0 0 0 1 0", "line 1: .* not a rotation with a uniform scale"),
        ("a.ply nan 0 0 0 0 1 0 0 0 0 1 0", "line 1: "),
        ("a.ply 1e300 0 0 0 0 1e300 0 0 0 0 1e300 0", "line 1: .*above 1e6"),
        ("a.ply\na.ply", "line 2: a.ply is named twice"),
        ("other.splats", "itself a list"),
        ("\n".join(f"{k}.ply" for k in range(101)), "names 101 splat files"),
    ],
)
def test_a_list_with_an_error_is_refused_with_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "house.splats").write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        listed_splats(tmp_path / "house.splats")
    assert "\n" not in str(raised.value)


def test_a_listed_file_that_is_missing_is_named(tmp_path: Path) -> None:
    (tmp_path / "house.splats").write_text("missing.ply\n")
    for read in (read_splats, recognize, source_up_axis, _fingerprint):
        with pytest.raises(InputError, match=r"missing\.ply"):
            read(tmp_path / "house.splats")
