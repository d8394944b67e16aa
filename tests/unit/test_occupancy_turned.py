"""Maps with a yaw, and the description of a map."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.occupancy.read import read_map
from nvsim.occupancy.ros import MARK, Provenance, read_provenance, write_ros_map
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap, transformed_map


def rotation(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def random_map(seed: int, rows: int = 9, columns: int = 14) -> OccupancyMap:
    cells = np.random.default_rng(seed).integers(0, 3, (rows, columns)).astype(np.uint8)
    return OccupancyMap(cells, 0.25, (-1.5, 0.75))


def with_yaw(folder: Path, occupancy: OccupancyMap, yaw: str) -> Path:
    """The file of a map whose lower left corner stays where it is while the rest turns about it."""
    path = folder / "map.yaml"
    write_ros_map(occupancy, path)
    x, y = occupancy.origin
    path.write_text(path.read_text().replace(f"[{x!r}, {y!r}, 0.0]", f"[{x!r}, {y!r}, {yaw}]"))
    return path


@pytest.mark.parametrize("yaw", ["1.5707963", "3.14159265", "-1.570796", "6.2831853", "4.71239"])
def test_a_right_angle_keeps_every_cell(tmp_path: Path, yaw: str) -> None:
    before = random_map(4)
    after = read_map(with_yaw(tmp_path, before, yaw))
    assert sorted(after.cells.shape) == sorted(before.cells.shape)
    corner = np.array(before.origin)
    places = corner + (before.centers() - corner) @ rotation(float(yaw)).T
    assert np.array_equal(after.states_at(places), before.cells)
    assert np.bincount(after.cells.ravel()).tolist() == np.bincount(before.cells.ravel()).tolist()


@settings(max_examples=25)
@given(st.floats(-7, 7), st.integers(0, 2**31))
def test_every_cell_has_the_state_that_the_map_has_at_its_middle(
    tmp_path_factory: pytest.TempPathFactory, yaw: float, seed: int
) -> None:
    before = random_map(seed)
    after = read_map(with_yaw(tmp_path_factory.mktemp("yaw"), before, repr(yaw)))
    corner = np.array(before.origin)
    back = corner + (after.centers() - corner) @ rotation(yaw)
    quarter = math.remainder(yaw, math.pi / 2)
    if abs(quarter) > 1e-4:
        assert np.array_equal(after.cells, before.states_at(back)) and after.resolution == before.resolution
    # Nothing lies beside the new grid.
    ends = corner + np.array([[0.01, 0.01], [3.49, 0.01], [0.01, 2.24], [3.49, 2.24]]) @ rotation(yaw).T
    index = after.index(ends)
    assert (index >= 0).all() and (index < after.cells.shape).all()


@pytest.mark.parametrize("degrees", [10, 30, 45, 77, 160])
def test_a_turned_disc_is_where_geometry_says(degrees: float) -> None:
    empty = OccupancyMap(np.zeros((300, 400), np.uint8), 0.02, (1.0, -2.0))
    middle, radius = np.array([4.0, 0.5]), 1.7
    far = np.linalg.norm(empty.centers() - middle, axis=-1)
    disc = OccupancyMap(np.where(far < radius, OCCUPIED, FREE), 0.02, (1.0, -2.0))
    turn = rotation(math.radians(degrees))
    after = transformed_map(disc, turn, (0.3, -0.2), 1.5)
    assert after.resolution == pytest.approx(0.03)
    away = np.linalg.norm(after.centers() - (1.5 * turn @ middle + (0.3, -0.2)), axis=-1)
    inside, outside = away < 1.5 * radius - 0.05, away > 1.5 * radius + 0.05
    assert (after.cells[inside] == OCCUPIED).all() and not (after.cells[outside] == OCCUPIED).any()
    area = (after.cells != UNKNOWN).sum() * after.resolution**2
    assert area == pytest.approx(1.5**2 * 300 * 400 * 0.02**2, rel=2e-3)


@pytest.mark.parametrize("degrees", range(1, 90, 7))
def test_a_wall_of_one_cell_stays_closed(degrees: int) -> None:
    from scipy.ndimage import label

    cells = np.zeros((81, 81), np.uint8)
    cells[40] = OCCUPIED
    after = transformed_map(OccupancyMap(cells, 0.05, (0.0, 0.0)), rotation(math.radians(degrees)))
    parts, count = label(after.cells == FREE)
    sizes = np.bincount(parts.ravel())[1:]
    assert count == 2 and min(sizes) > 0.9 * max(sizes)


def test_a_map_remembers_what_it_was_made_from(tmp_path: Path) -> None:
    said = Provenance("trained", 'rendered depth, "weak"', 0.1, 1.5, ("ab", "cd"))
    path = tmp_path / "map.yaml"
    write_ros_map(random_map(1), path, said)
    assert read_provenance(path) == said
    assert np.array_equal(read_map(path).cells, random_map(1).cells), "other programs take the line for a remark"
    write_ros_map(random_map(1), path)
    assert read_provenance(path) is None and read_provenance(tmp_path / "map.bt") is None


@pytest.mark.parametrize(
    "damaged",
    ["{", "[]", "{}", '{"source": "guess", "note": "", "from_height": 0, "to_height": 1, "makers": []}', "1e999", "\0"],
)
def test_a_damaged_remark_ends_in_a_sentence(tmp_path: Path, damaged: str) -> None:
    path = tmp_path / "map.yaml"
    write_ros_map(random_map(1), path)
    path.write_text(f"{MARK} {damaged}\n{path.read_text()}")
    with pytest.raises(InputError, match="delete the line"):
        read_provenance(path)


@settings(max_examples=50)
@given(st.text(max_size=80))
def test_any_remark_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, words: str) -> None:
    path = tmp_path_factory.mktemp("remark") / "map.yaml"
    path.write_text(f"{MARK} {words}\n", encoding="utf-8", errors="replace")
    try:
        found = read_provenance(path)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert found is None or found.source


@pytest.mark.parametrize("name", ["ground floor", "a#b", "it's", 'the "best"', "a: b", "Küche", " x", "a # b"])
def test_a_map_of_any_name_reads_back(tmp_path: Path, name: str) -> None:
    path = tmp_path / f"{name}.yaml"
    write_ros_map(random_map(2), path)
    assert np.array_equal(read_map(path).cells, random_map(2).cells)


def test_a_pair_is_replaced_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.yaml"
    write_ros_map(random_map(1), path)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}

    def full(self: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="disk is full"):
        write_ros_map(random_map(2), path)
    monkeypatch.undo()
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
