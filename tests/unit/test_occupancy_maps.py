"""Reading, writing and walking on occupancy maps."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from columns import fill, room
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.errors import InputError
from nvsim.occupancy.octomap import read_octomap
from nvsim.occupancy.paths import clearance, reachable, segment_is_free, visible
from nvsim.occupancy.read import read_map
from nvsim.occupancy.ros import write_ros_map
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap


def ros_pair(folder: Path, yaml: str, pixels: list[list[int]]) -> Path:
    gray = np.array(pixels, np.uint8)
    (folder / "map.pgm").write_bytes(
        f"P5\n# a comment\n{gray.shape[1]} {gray.shape[0]}\n255\n".encode() + gray.tobytes()
    )
    (folder / "map.yaml").write_text(yaml)
    return folder / "map.yaml"


YAML = (
    "image: map.pgm\nresolution: 0.1\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def test_first_picture_row_is_the_highest_y(tmp_path: Path) -> None:
    found = read_map(ros_pair(tmp_path, YAML, [[0, 254], [205, 254]]))
    assert found.cells.tolist() == [[UNKNOWN, FREE], [OCCUPIED, FREE]]
    assert found.states_at(np.array([[-0.95, 2.15], [-0.95, 2.05], [-0.85, 2.05], [5, 5]])).tolist() == [
        OCCUPIED,
        UNKNOWN,
        FREE,
        UNKNOWN,
    ]


def test_negate_turns_white_into_walls(tmp_path: Path) -> None:
    found = read_map(ros_pair(tmp_path, YAML.replace("negate: 0", "negate: 1"), [[255, 0, 128]]))
    assert found.cells.tolist() == [[OCCUPIED, FREE, UNKNOWN]]


def test_raw_mode_takes_values_as_percent(tmp_path: Path) -> None:
    found = read_map(ros_pair(tmp_path, YAML + "mode: raw\n", [[0, 100, 50, 255]]))
    assert found.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN, UNKNOWN]]


@pytest.mark.parametrize(
    "change",
    [
        ("[-1.0, 2.0, 0.0]", "[-1.0,\n  2.0, 0.0]"),
        ("[-1.0, 2.0, 0.0]", "[\n  -1.0, # x\n  2.0,   # y\n  0.0\n ]"),
        ("[-1.0, 2.0, 0.0]", "\n- -1.0\n- 2.0\n- 0.0"),
        ("[-1.0, 2.0, 0.0]", "[-1, 2e0, '0.0']"),
        ("[-1.0, 2.0, 0.0]", "[-1.0, 2.0]"),
        ("[-1.0, 2.0, 0.0]", "[-10e-1, +2, 0.]   # yaw is 0"),
        ("origin: [-1.0, 2.0, 0.0]", "start: &o [-1.0, 2.0, 0.0]\norigin: *o"),
        ("origin: [-1.0, 2.0, 0.0]", '"origin" : !!seq [-1.0, 2.0, !!float 0]'),
        ("resolution: 0.1", "resolution: 1e-1"),
        ("resolution: 0.1", 'resolution: "0.1"'),
        ("resolution: 0.1", "resolution: 1E-01 # m"),
        ("map.pgm", "'map.pgm'"),
        ("map.pgm", '"map.pgm"   # the image'),
        ("map.pgm", "./map.pgm"),
        ("map.pgm", ">-\n  map.pgm"),
        ("negate: 0", "negate: false"),
        ("negate: 0", "negate: No"),
        ("negate: 0\n", ""),
        ("image", "---\nimage"),
        ("image", "%YAML 1.1\n---\n# a map\nimage"),
        ("\n", "\r\n"),
        ("image", "\ufeffimage"),
        ("negate: 0", "negate: 0\nmode: Trinary\nother: {a: [1, 2], b: text}"),
    ],
    ids=range(23),
)
def test_every_way_to_write_the_same_map_in_yaml_reads_the_same(tmp_path: Path, change: tuple[str, str]) -> None:
    found = read_map(ros_pair(tmp_path, YAML.replace(*change), [[0, 254], [205, 254]]))
    assert (found.origin, found.resolution, found.notes) == ((-1.0, 2.0), 0.1, ())
    assert found.cells.tolist() == [[UNKNOWN, FREE], [OCCUPIED, FREE]]


@pytest.mark.parametrize("text", ["1", "true", "True", "yes", "on", "'1'"])
def test_negate_is_understood_as_yaml_writes_it(tmp_path: Path, text: str) -> None:
    found = read_map(ros_pair(tmp_path, YAML.replace("negate: 0", f"negate: {text}"), [[255, 0, 128]]))
    assert found.cells.tolist() == [[OCCUPIED, FREE, UNKNOWN]]


def test_whole_map_as_one_flow_mapping(tmp_path: Path) -> None:
    text = "{image: map.pgm, resolution: 0.1, origin: [-1.0, 2.0, 0.0]}"
    assert read_map(ros_pair(tmp_path, text, [[0]])).origin == (-1.0, 2.0)


def test_aliases_of_aliases_take_neither_time_nor_memory(tmp_path: Path) -> None:
    bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n"
    bomb += "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 40))
    began = time.process_time()
    assert read_map(ros_pair(tmp_path, bomb + YAML, [[0]])).origin == (-1.0, 2.0)
    with pytest.raises(InputError, match="origin is"):
        read_map(ros_pair(tmp_path, bomb + YAML.replace("[-1.0, 2.0, 0.0]", "*a39"), [[0]]))
    assert time.process_time() - began < 2


def test_tags_of_python_run_nothing(tmp_path: Path) -> None:
    text = YAML + f"x: !!python/object/apply:os.mkdir [{tmp_path / 'made'}]\n"
    assert read_map(ros_pair(tmp_path, text, [[0]])).origin == (-1.0, 2.0)
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    "image",
    [
        "/home/ann/map.pgm",
        r"C:\maps\map.pgm",
        r"'C:\maps\map.pgm'",
        "C:/maps/map.pgm",
        r"\\server\share\map.pgm",
        "old/folder/map.pgm",
        "../maps/map.pgm",
        r"maps\map.pgm",
        "MAP.PGM",
        "/home/ann/Map.pgm",
        "file:///home/ann/map.pgm",
    ],
)
def test_image_of_a_moved_map_is_found_by_its_name_with_a_note(tmp_path: Path, image: str) -> None:
    found = read_map(ros_pair(tmp_path, YAML.replace("map.pgm", image), [[0, 254]]))
    assert found.cells.tolist() == [[OCCUPIED, FREE]]
    (note,) = found.notes
    assert "is not there" in note and str(tmp_path / "map.pgm") in note


def test_note_about_a_moved_image_stays_with_a_map_that_is_turned(tmp_path: Path) -> None:
    text = YAML.replace("map.pgm", "/home/ann/map.pgm").replace("2.0, 0.0]", "2.0, 0.3]")
    assert len(read_map(ros_pair(tmp_path, text, [[0, 254]])).notes) == 1


def test_image_in_a_folder_of_windows_is_taken_before_one_beside(tmp_path: Path) -> None:
    path = ros_pair(tmp_path, YAML.replace("map.pgm", r"maps\map.pgm"), [[0, 254]])
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "map.pgm").write_bytes(b"P5\n1 1\n255\n\xfe")
    assert read_map(path).cells.tolist() == [[FREE]]


def test_absolute_path_that_exists_is_taken_without_a_note(tmp_path: Path) -> None:
    (tmp_path / "away").mkdir()
    (tmp_path / "away" / "map.pgm").write_bytes(b"P5\n1 1\n255\n\xfe")
    found = read_map(ros_pair(tmp_path, YAML.replace("map.pgm", str(tmp_path / "away" / "map.pgm")), [[0, 254]]))
    assert (found.cells.tolist(), found.notes) == ([[FREE]], ())


def test_images_that_differ_only_in_case_are_not_guessed_between(tmp_path: Path) -> None:
    path = ros_pair(tmp_path, YAML.replace("map.pgm", "Map.PGM"), [[0]])
    (tmp_path / "MAP.pgm").write_bytes((tmp_path / "map.pgm").read_bytes())
    with pytest.raises(InputError, match="MAP.pgm, map.pgm beside it differ only in case"):
        read_map(path)


def test_image_that_is_nowhere_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"Cannot read /home/ann/other.pgm: it does not exist.*map.yaml names it"):
        read_map(ros_pair(tmp_path, YAML.replace("map.pgm", "/home/ann/other.pgm"), [[0]]))


def test_comparison_prints_the_note_about_a_moved_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from nvsim.cli.main import main

    moved = ros_pair(tmp_path, YAML.replace("map.pgm", "/home/ann/map.pgm"), [[0, 254]])
    assert main(["occupancy", "compare", str(moved), str(moved), "--json"]) == 0
    out, err = capsys.readouterr()
    assert out.count("\n") == 1 and err.count("note: ") == 1 and "/home/ann/map.pgm is not there" in err


def test_origin_may_be_a_list_of_dashes(tmp_path: Path) -> None:
    text = YAML.replace("origin: [-1.0, 2.0, 0.0]", "origin:\n  - -1.0\n  - 2.0\n  - 0.0")
    assert read_map(ros_pair(tmp_path, text, [[0]])).origin == (-1.0, 2.0)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 7), st.integers(1, 9), st.integers(0, 2**31), st.floats(0.01, 1), st.floats(-99, 99))
def test_written_map_reads_back(
    tmp_path_factory: pytest.TempPathFactory, rows: int, columns: int, seed: int, resolution: float, x: float
) -> None:
    cells = np.random.default_rng(seed).integers(0, 3, (rows, columns)).astype(np.uint8)
    path = tmp_path_factory.mktemp("map") / "m.yaml"
    write_ros_map(OccupancyMap(cells, resolution, (x, -x)), path)
    found = read_map(path)
    assert np.array_equal(found.cells, cells) and (found.resolution, found.origin) == (resolution, (x, -x))


@pytest.mark.parametrize(
    ("yaml", "words"),
    [
        (YAML.replace("resolution: 0.1", "resolution: fine"), "line 2.*number"),
        (YAML.replace("resolution: 0.1", "resolution: 0"), "positive"),
        (YAML.replace("origin: [-1.0, 2.0, 0.0]", "origin: [0, 0, left]"), "number"),
        (YAML.replace("origin: [-1.0, 2.0, 0.0]", "origin: [0]"), r"\[x, y, yaw\]"),
        (YAML.replace("image: map.pgm\n", ""), "no line 'image:'"),
        (YAML.replace("map.pgm", "other.pgm"), "other.pgm"),
        (YAML + "mode: fancy\n", "fancy"),
        ("just words\n", "line 1"),
        ("- a\n- b\n", "line 1"),
        ("", "no line 'image:'"),
        (YAML.replace("-1.0, 2.0", "-1.0,\n  left"), "line 4: origin is 'left'"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "-1.0, 2.0, 0.0"), r"line 3: origin .*\[x, y, yaw\]"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "[-1.0, 2.0, 0.0"), "line 4: this is not YAML"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "[-1.0, [2.0], 0.0]"), "line 3: origin .*number"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "{x: 1, y: 2}"), "line 3: origin is a table"),
        (YAML.replace("resolution: 0.1", "resolution: 0,1"), "line 2: resolution is '0,1'"),
        (YAML.replace("resolution: 0.1", "resolution: .nan"), "line 2: resolution .*number"),
        (YAML.replace("resolution: 0.1", "resolution: [0.1]"), "line 2: resolution is .0.1.; it must be a number"),
        (YAML.replace("negate: 0", "negate: maybe"), "line 4: negate"),
        (YAML.replace("negate: 0", "negate: [0]"), "line 4: negate is .0.; it must be a single value"),
        (YAML.replace("0.65", "65"), "line 5: occupied_thresh .* between 0 and 1"),
        (YAML.replace("image: map.pgm", "image:"), "line 1: image names no file"),
        (YAML.replace("image: map.pgm", "image: [map.pgm]"), "line 1: image"),
        (YAML.replace("map.pgm", '"C:\\maps\\map.pgm"'), "line 1: this is not YAML .*escape"),
        (YAML + "origin: [0, 0, 0]\n", "line 7: origin is given twice with other values"),
        ("base: &b {negate: 0}\n<<: *b\n" + YAML, "line 2: merged keys"),
        (YAML + "---\n" + YAML, "not YAML"),
        (YAML.replace("negate: 0", "negate:\t0\n\tx: 1"), "line 4: this is not YAML"),
        ("a: " + "[" * 5000 + "]" * 5000 + "\n" + YAML, "nested too deeply"),
        (YAML + "#" * 100_000, "100"),
    ],
)
def test_bad_ros_map_is_refused_with_a_sentence(tmp_path: Path, yaml: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_map(ros_pair(tmp_path, yaml, [[0]]))


def test_bad_paths_are_refused(tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"")
    for name, words in (("map.pgm", "its .yaml"), ("no.yaml", "Cannot read"), ("no.bt", "Cannot read"), ("x", "exist")):
        with pytest.raises(InputError, match=words):
            read_map(tmp_path / name)


@settings(max_examples=50, deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_as_ros_map_or_octomap_raise_only_input_errors(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    folder = tmp_path_factory.mktemp("fuzz")
    for name, content in (("m.yaml", data), ("a.bt", data), ("b.bt", OCTREE_HEADER + data)):
        (folder / name).write_bytes(content)
        try:
            read_map(folder / name)
        except InputError:
            continue


OCTREE_HEADER = b"# Octomap OcTree binary file\nid OcTree\nsize 2\nres 0.1\ndata\n"


def octree(voxels: dict[tuple[int, int, int], int]) -> bytes:
    """A binary tree with single voxels (x, y, z from the middle of the tree) free (1) or occupied (2)."""

    def node(items: dict[tuple[int, int, int], int], size: int) -> bytes:
        half, bits, inner = size // 2, 0, b""
        for i in range(8):
            base = (half * (i & 1), half * ((i >> 1) & 1), half * ((i >> 2) & 1))
            mine = {
                (x - base[0], y - base[1], z - base[2]): s
                for (x, y, z), s in items.items()
                if base[0] <= x < base[0] + half and base[1] <= y < base[1] + half and base[2] <= z < base[2] + half
            }
            if mine and half == 1:
                bits |= mine[0, 0, 0] << (2 * i)
            elif mine:
                bits |= 3 << (2 * i)
                inner += node(mine, half)
        return bits.to_bytes(2, "little") + inner

    center = 1 << 15
    return OCTREE_HEADER + node({(x + center, y + center, z + center): s for (x, y, z), s in voxels.items()}, 1 << 16)


def test_octomap_is_cut_between_two_heights_over_its_floor(tmp_path: Path) -> None:
    floor = {(x, y, -1): 2 for x in range(4) for y in range(3)}
    voxels = floor | {(0, 0, 5): 1, (1, 0, 5): 2, (1, 0, 7): 1, (2, 0, 5): 1, (2, 0, 40): 2, (3, 2, 0): 2}
    path = tmp_path / "m.bt"
    path.write_bytes(octree(voxels))
    found = read_octomap(path)
    assert found.resolution == 0.1 and np.allclose(found.origin, 0)
    assert found.cells.tolist() == [
        [FREE, OCCUPIED, FREE, UNKNOWN],
        [UNKNOWN] * 4,
        [UNKNOWN] * 4,
    ]
    path.write_bytes(octree(voxels)[:-1])
    with pytest.raises(InputError, match="middle of the tree"):
        read_octomap(path)


@pytest.mark.data
def test_corridor_of_a_published_octomap_is_free_and_walled(shared_data: Path) -> None:
    found = read_map(shared_data / "maps" / "geb079.bt")
    assert found.resolution == 0.08
    counts = np.bincount(found.cells.ravel(), minlength=3)
    assert counts[FREE] > 30_000 and counts[OCCUPIED] > 10_000
    # The building is known for its straight corridor of some 34 m.
    rows = (found.cells == FREE).sum(axis=1)
    y = found.centers()[int(np.argmax(rows)), 0, 1]
    along = np.flatnonzero(found.cells[int(np.argmax(rows))] == FREE) * found.resolution + found.origin[0]
    assert along.max() - along.min() > 30
    assert segment_is_free(found, np.array([-2.0, y]), np.array([8.0, y]))


@pytest.mark.data
def test_published_ros_map_reads_as_its_gray_values_say(shared_data: Path) -> None:
    found = read_map(shared_data / "maps" / "map.yaml")
    assert found.cells.shape == (384, 384) and found.origin == (-10.0, -10.0)
    assert np.bincount(found.cells.ravel()).tolist() == [7939, 795, 138722]


def test_clearance_and_segments_know_walls() -> None:
    occupancy = fill(room(4, 4), 1.95, 0, 2.05, 3, OCCUPIED)
    assert segment_is_free(occupancy, np.array([0.5, 3.5]), np.array([3.5, 3.5]), 0.4)
    assert not segment_is_free(occupancy, np.array([0.5, 3.5]), np.array([3.5, 3.5]), 0.6)
    assert not segment_is_free(occupancy, np.array([0.5, 1.0]), np.array([3.5, 1.0]))
    assert not segment_is_free(occupancy, np.array([0.5, 1.0]), np.array([0.5, 9.0]))
    middle = occupancy.index(np.array([1.0, 1.5]))
    assert clearance(occupancy)[tuple(middle)] == pytest.approx(0.95, abs=0.051)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31))
def test_segments_agree_with_dense_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = (rng.uniform(size=(12, 12)) < 0.15).astype(np.uint8)
    occupancy = OccupancyMap(cells, 0.5, (0.0, 0.0))
    a, b = rng.uniform(0.01, 5.99, (2, 2))
    sampled = occupancy.states_at(a + np.linspace(0, 1, 20001)[:, None] * (b - a))
    assert segment_is_free(occupancy, a, b) == bool((sampled == FREE).all())


def test_reach_ends_at_walls_and_at_doors_that_are_too_narrow() -> None:
    closed = fill(room(6, 4), 2.95, 0, 3.05, 4, OCCUPIED)
    door = fill(closed, 2.9, 1.5, 3.1, 2.1, FREE)
    seed = np.array([[1.0, 1.0]])
    half = reachable(closed, seed).sum()
    assert half * 0.05**2 == pytest.approx(2.95 * 4, rel=0.03)
    assert reachable(door, seed).sum() > 1.9 * half
    assert not reachable(door, seed, radius=0.4)[tuple(door.index(np.array([5.0, 2.0])))]
    assert reachable(door, seed, radius=0.2)[tuple(door.index(np.array([5.0, 2.0])))]
    assert not reachable(closed, np.array([[-1.0, -1.0], [99.0, 0.0]])).any()


def test_sight_is_a_disc_cut_by_walls() -> None:
    occupancy = room(10, 10)
    seen = visible(occupancy, np.array([5.0, 5.0]), 2.5)
    assert seen.sum() * 0.05**2 == pytest.approx(np.pi * 2.5**2, rel=0.01)
    # An endless wall 1 m away leaves the disc less its segment.
    walled = fill(occupancy, 6, 0, 6.1, 10, OCCUPIED)
    segment = 2.5**2 * np.arccos(1 / 2.5) - np.sqrt(2.5**2 - 1)
    assert visible(walled, np.array([5.0, 5.0]), 2.5).sum() * 0.05**2 == pytest.approx(
        np.pi * 2.5**2 - segment, rel=0.01
    )
    assert not visible(occupancy, np.array([-2.0, 5.0]), 2.5).any(), "nobody sees from unknown cells"
