"""Captures, images and maps that announce more than they hold end in one sentence, before any memory is taken."""

from __future__ import annotations

import json
import os
import resource
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import capture_samples as sample
import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nvsim.capture.check import check
from nvsim.capture.findings import Findings
from nvsim.capture.images import decode
from nvsim.capture.multi_capture import listed_captures, write_list
from nvsim.capture.pointcloud import read_cloud
from nvsim.capture.read import read
from nvsim.capture.store import load_capture, save_capture
from nvsim.errors import InputError
from nvsim.files.images import image_size_of

HUGE = "9" * 400


@contextmanager
def memory_for(megabytes: int) -> Iterator[None]:
    """The process may take that much more address space than it has."""
    with open("/proc/self/status") as file:
        now = next(int(line.split()[1]) for line in file if line.startswith("VmSize")) << 10
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (now + (megabytes << 20), before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def refusal(action: Callable[[], object]) -> str:
    """The sentence with which `action` is refused, soon and within 300 MB."""
    began = time.process_time()
    with memory_for(300), pytest.raises(InputError) as refused:
        action()
    assert time.process_time() - began < 2
    sentence = str(refused.value)
    assert sentence.endswith(".") and "\n" not in sentence
    return sentence


def png(width: int, height: int, body: bytes = b"\0") -> bytes:
    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    data = bytearray(cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8))[1].tobytes())
    at = data.find(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", height, width)
    return bytes(data)


IMAGES = {
    "a PNG with a lying header": png(30_000, 30_000),
    "a PNG of many gigabytes": png(2**31 - 1, 2**31 - 1),
    "a JPEG with a lying header": jpeg(65_500, 65_500),
    "a PGM of height 10^9": b"P5 20 1000000000 255\n" + b"\0" * 100,
    "a PGM that ends early": b"P5 5000 5000 255\n" + b"\0" * 100,
    "a BMP": b"BM" + struct.pack("<IIIIiiHHI", 60, 0, 54, 40, 60_000, -60_000, 1, 24, 0) + b"\0" * 40,
    "a format that is not read": b"GIF89a" + struct.pack("<HH", 60_000, 60_000) + b"\0" * 40,
    "a header that ends early": png(10, 10)[:20],
}


@pytest.mark.parametrize("content", IMAGES.values(), ids=IMAGES)
def test_an_image_is_judged_by_its_header_before_it_is_decoded(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "image"
    path.write_bytes(content)
    sentence = refusal(lambda: decode(path))
    assert str(path) in sentence and "cannot allocate" not in sentence.lower()
    assert any(
        words in sentence for words in ("the limit is 200 mega", "too many for its", "are supported", "is truncated")
    )


def test_a_bomb_in_the_place_of_a_frame_is_another_size_than_its_camera(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    (tmp_path / "images" / "003.png").write_bytes(png(12_000, 12_000, b"\0" * (12_000 * 36_001)))
    with memory_for(400):
        report = check(path)
    (finding,) = [f for f in report.findings if f.severity == "error"]
    assert "12000x12000 pixels but its camera is 64x48" in finding.message and "frame 3" in finding.where


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([".png", ".jpg", ".webp", ".bmp", ".tiff", ".ppm", ".pgm"]), st.integers(1, 90), st.integers(1, 90)
)
def test_the_header_says_what_opencv_decodes(suffix: str, width: int, height: int) -> None:
    image = (
        np.random.default_rng(width).integers(0, 255, (height, width, 1 if suffix == ".pgm" else 3)).astype(np.uint8)
    )
    data = cv2.imencode(suffix, image)[1].tobytes()
    found = image_size_of(data)
    assert found is not None and (found.width, found.height) == (width, height) and found.least_bytes <= len(data)


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(
        [b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"P5 ", b"P3\n#", b"RIFF0000WEBPVP8X", b"II*\0", b"MM\0*", b"BM"]
    ),
    st.binary(max_size=120),
)
def test_any_bytes_as_an_image_header_have_a_size_or_none(head: bytes, rest: bytes) -> None:
    image_size_of(head + rest)


@pytest.mark.parametrize("distance", [5e3, 9e6])
@pytest.mark.parametrize("count", [1, 4])
def test_frames_far_from_the_walk_are_refused_by_name_and_left_out_on_demand(
    tmp_path: Path, distance: float, count: int
) -> None:
    poses = sample.walk(20)
    poses[5 : 5 + count, 0, 3] += distance
    path = sample.write_nerfstudio(tmp_path, poses, sample.room())
    names = ",".join(f"images/{i:03d}.png" for i in range(5, 5 + count))
    (finding,) = [f for f in check(path).findings if f.severity == "error"]
    assert finding.message.endswith(f"--leave-out {names}") and "frame 5" in finding.where
    assert not check(path, leave_out=names).refused
    assert len(read(path, leave_out=names).frames) == 20 - count
    assert "'nobody.png', which is not a frame" in refusal(lambda: read(path, leave_out="nobody.png"))


def test_a_walk_that_is_wider_than_any_map_is_refused_before_any_work(tmp_path: Path) -> None:
    poses = sample.walk(40)
    poses[:, 0, 3], poses[:, 1, 3] = np.linspace(0, 900, 40), np.linspace(0, 900, 40)
    (finding,) = [
        f for f in check(sample.write_nerfstudio(tmp_path, poses, sample.room())).findings if f.severity == "error"
    ]
    assert "900 x 900 m" in finding.message and "--leave-out" in finding.consequence


def test_a_robot_that_stands_still_for_half_of_the_time_is_not_far_from_itself(tmp_path: Path) -> None:
    poses = sample.walk(40)
    poses[:25, :3, 3] = poses[0, :3, 3] + np.random.default_rng(0).normal(0, 1e-3, (25, 3))
    assert not check(sample.write_nerfstudio(tmp_path, poses, sample.room())).refused


def test_a_frame_with_a_pose_that_is_none_can_be_left_out(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    tree = json.loads(path.read_text())
    tree["frames"][2]["transform_matrix"][0][3] = 1e30
    tree["frames"][3]["file_path"] = "images/a, b.png"
    (tmp_path / "images" / "003.png").rename(tmp_path / "images" / "a, b.png")
    path.write_text(json.dumps(tree))
    assert check(path).refused
    assert len(read(path, leave_out="images/002.png,images/a, b.png").frames) == 10


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("cameras", "1 PINHOLE 64", f"1 PINHOLE {HUGE}", "line 2"),
        ("images", "1 ", f"{HUGE} ", "line 2"),
        ("points3D", " 10 20 30", f" {HUGE} 20 30", "line 2"),
        ("cameras", "1 PINHOLE 64", "1 PINHOLE 999999999999", "two whole numbers"),
    ],
)
def test_a_number_of_400_digits_in_a_colmap_text_is_told_by_its_line(
    tmp_path: Path, name: str, old: str, new: str, words: str
) -> None:
    sample.write_colmap(tmp_path, sample.walk(4), sample.room(60), binary=False)
    path = tmp_path / "sparse" / "0" / f"{name}.txt"
    path.write_text(path.read_text().replace(old, new, 1))
    sentence = refusal(lambda: read(tmp_path))
    assert f"{name}.txt" in sentence and words in sentence


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_a_colmap_binary_that_announces_2_to_the_60_records_ends_at_its_last(tmp_path: Path, name: str) -> None:
    sample.write_colmap(tmp_path, sample.walk(4), sample.room(60), binary=True)
    path = tmp_path / "sparse" / "0" / f"{name}.bin"
    path.write_bytes(struct.pack("<Q", 2**60) + path.read_bytes()[8:])
    assert f"{name}.bin ends in the middle of" in refusal(lambda: read(tmp_path))


DEEP = "[" * 800 + "]" * 800


@pytest.mark.parametrize("value", ["[" * 10**5, "9" * 5000, f"{DEEP}", '{"a":' * 5000, HUGE, "NaN", "1e999"])
@pytest.mark.parametrize("key", ["fl_x", "w", "frames"])
def test_no_json_value_gets_through_as_a_traceback(tmp_path: Path, key: str, value: str) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(4), sample.room(60))
    tree = json.loads(path.read_text())
    tree[key] = "HERE"
    path.write_text(json.dumps(tree).replace('"HERE"', value))
    assert "transforms.json" in refusal(lambda: read(path))
    assert check(path).refused


AXES = "property float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n"


def ply(*lines: str) -> bytes:
    return "\n".join(["ply", "format ascii 1.0", *lines, AXES]).encode()


def pcd(fields: int, points: str, data: str = "binary") -> bytes:
    columns = {"FIELDS": "x", "SIZE": "8", "TYPE": "F", "COUNT": "4096"}
    head = "".join(f"{key} {' '.join([value] * fields)}\n" for key, value in columns.items())
    return f"{head}POINTS {points}\nDATA {data}\n0 0 0\n".encode()


CLOUDS = {
    "a PLY of 10^14 points": ply("element vertex 99999999999999"),
    "a PLY whose points come after 10^14 lines": ply("element face 99999999999999", "element vertex 1"),
    "a PLY with lists": ply("element vertex 1", "property list int float x"),
    "a PCD with rows of many gigabytes": pcd(600, "99999999999"),
    "a PCD of 10^400 points": pcd(3, HUGE, "ascii"),
    "a PCD with one row too large for a type": pcd(200_000, "1"),
}


@pytest.mark.parametrize("content", CLOUDS.values(), ids=CLOUDS)
def test_a_cloud_that_announces_more_than_it_holds_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "cloud"
    path.write_bytes(content)
    assert str(path) in refusal(lambda: read_cloud(path, Findings()))


def test_rigs_on_rigs_on_rigs_end_soon(tmp_path: Path) -> None:
    folder = sample.write_kapture(tmp_path, sample.walk(4), sample.room(60))
    rows = [
        f"r{level}_{i}, {below}, 1, 0, 0, 0, 0, 0, 0"
        for level in range(8)
        for i in range(12)
        for below in (["lidar0"] if level == 0 else [f"r{level - 1}_{k}" for k in range(12)])
    ]
    (folder / "sensors" / "rigs.txt").write_text("\n".join(rows))
    (folder / "sensors" / "trajectories.txt").write_text("5, nobody, 1, 0, 0, 0, 0, 0, 0\n")
    began = time.process_time()
    assert check(folder).refused
    assert time.process_time() - began < 2


def test_a_file_of_nothing_but_faults_is_told_in_part(tmp_path: Path) -> None:
    folder = sample.write_kapture(tmp_path, sample.walk(4), sample.room(60))
    (folder / "sensors" / "trajectories.txt").write_text("a\n" * 20_000)
    report = check(folder)
    assert 5000 <= len(report.findings) < 5100 and any("more findings" in f.message for f in report.findings)


def test_a_list_of_captures_with_a_nul_is_told_by_its_line(tmp_path: Path) -> None:
    path = tmp_path / "both.captures"
    path.write_bytes(b"# two\nwalk\0one\n")
    assert f"{path}, line 2" in refusal(lambda: listed_captures(path))


def test_a_capture_whose_path_cannot_stand_in_a_list_is_refused_before_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "both.captures"
    assert "cannot be written to a list" in refusal(lambda: write_list([tmp_path / "walk #2"], path))
    assert not path.exists()


def test_a_pipe_a_device_or_a_folder_in_the_place_of_a_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    path = sample.write_nerfstudio(tmp_path, sample.walk(), sample.room())
    for image, make in (("003.png", os.mkfifo), ("004.png", os.mkdir)):
        (tmp_path / "images" / image).unlink()
        make(tmp_path / "images" / image)
    (tmp_path / "cloud.ply").unlink()
    (tmp_path / "cloud.ply").symlink_to("/dev/zero")
    assert len([f for f in check(path).findings if f.severity == "error"]) >= 3
    path.unlink()
    os.mkfifo(path)
    assert "name a regular file" in refusal(lambda: read(path))
    several = tmp_path / "x.captures"
    os.mkfifo(several)
    assert "name a regular file" in refusal(lambda: read(several))


def test_a_capture_in_a_folder_that_is_not_utf_8_is_read_listed_and_stored(tmp_path: Path) -> None:
    sample.write_nerfstudio(tmp_path / "walk", sample.walk(), sample.room())
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    (tmp_path / "walk").rename(folder)
    assert not check(folder).refused
    write_list([folder], folder / "all.captures")
    assert listed_captures(folder / "all.captures") == [folder]
    capture = read(folder)
    save_capture(capture, folder / "stored")
    again = load_capture(folder / "stored")
    assert again.frames[0].image_path == capture.frames[0].image_path and decode(again.frames[0].image_path).size


def _changed(tree: dict, *path: object, value: object) -> bytes:
    place = tree
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return json.dumps(tree).encode()


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("version",), [1]),
        (("frames",), []),
        (("frames", 0, "image"), "a\0b"),
        (("frames", 0, "camera_to_world", 0, 3), float("nan")),
        (("frames", 0, "camera_to_world", 0, 3), 1e300),
        (("frames", 0, "timestamp"), 10**400),
        (("frames", 1, "name"), "images/000.png"),
        (("lenses", 0, "width"), 10**9),
        (("lenses", 0, "params", 0), 1e400),
        (("alignment", "scale"), 0),
        (("alignment", "rotation"), []),
        (("cloud", "file"), "../../elsewhere.npz"),
        (("cloud", "file"), "/dev/zero"),
        (("source",), 5),
    ],
)
def test_a_stored_capture_with_a_value_that_cannot_be_is_damaged(
    tmp_path: Path, path: tuple[object, ...], value: object
) -> None:
    save_capture(read(sample.write_nerfstudio(tmp_path / "in", sample.walk(4), sample.room(60))), tmp_path)
    stored = tmp_path / "capture.json"
    stored.write_bytes(_changed(json.loads(stored.read_text()), *path, value=value))
    assert "import the capture again" in refusal(lambda: load_capture(tmp_path))
