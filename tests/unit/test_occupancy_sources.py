"""Sources of rays: LiDAR scans and depth images of captures, in all their formats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import measured_room
import numpy as np
import pytest
from measured_room import BOX, poses, truth, write_kapture, write_nerfstudio

from nvsim.capture.findings import Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.multi_capture import write_list
from nvsim.capture.read import read
from nvsim.capture.sweeps import depth_sweeps, scan_sweeps, scans_with_places
from nvsim.capture.types import Capture
from nvsim.errors import InputError
from nvsim.occupancy.types import FREE, Heights, compare_maps
from nvsim.project.occupancy_maps import BuiltMap, build_occupancy
from nvsim.project.occupancy_sources import Wanted, find_rays

Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def built(capture: Capture, wanted: Wanted = "auto") -> BuiltMap:
    return build_occupancy(capture, None, find_rays(capture, None, wanted), camera_height=1.31)


def off_the_room(points: np.ndarray) -> np.ndarray:
    """(N,) meters from the surfaces of the room and of the box."""
    outer = np.array([measured_room.SIDE, measured_room.SIDE]) - np.abs(points[:, :2])
    shell = np.minimum(np.abs(outer).min(axis=1), np.abs(points[:, 2:] - [0, measured_room.CEILING]).min(axis=1))
    beyond = np.maximum(BOX[0] - points, points - BOX[1])
    on_box = np.where(beyond.max(axis=1) > 0, np.linalg.norm(np.maximum(beyond, 0), axis=1), -beyond.max(axis=1))
    return np.minimum(shell, np.abs(on_box))


def test_scans_of_a_scanner_on_a_rig_end_on_the_walls(tmp_path: Path) -> None:
    walked = poses(6)
    capture = read(write_kapture(tmp_path, walked))
    scans = scans_with_places(capture.scans)
    assert len(scans) == 6
    for sweep, pose in zip(scan_sweeps(scans), walked, strict=True):
        assert np.allclose(sweep.origin, (pose @ np.linalg.inv(measured_room.MOUNT))[:3, 3], atol=1e-6)
        assert off_the_room(sweep.points).max() < 1e-5


def test_depth_images_of_both_formats_end_on_the_walls(tmp_path: Path) -> None:
    walked = poses(6)
    raw = read(write_kapture(tmp_path / "kapture", walked, depth=True), camera_height=1.31)
    png = read(write_nerfstudio(tmp_path / "nerfstudio", walked), camera_height=1.31)
    for capture, tolerance in ((raw, 1e-5), (png, 1e-3)):
        assert len(capture.depths) == 6 and not capture.scans
        for sweep, pose in zip(depth_sweeps(capture.depths, 320), walked, strict=True):
            assert np.allclose(sweep.origin, pose[:3, 3], atol=1e-6)
            assert len(sweep.points) == 64 * 48 and off_the_room(sweep.points).max() < tolerance


def test_a_depth_image_of_another_size_than_the_image_keeps_its_view(tmp_path: Path) -> None:
    path = write_nerfstudio(tmp_path, poses(3))
    for file in (tmp_path / "depth").iterdir():
        stored = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(file), cv2.resize(stored, (128, 96), interpolation=cv2.INTER_NEAREST))
    for sweep in depth_sweeps(read(path, camera_height=1.31).depths, 320):
        assert len(sweep.points) == 64 * 48 and off_the_room(sweep.points).max() < 2e-3
    fewer = next(depth_sweeps(read(path, camera_height=1.31).depths, 32))
    assert len(fewer.points) == 32 * 24 and np.median(off_the_room(fewer.points)) < 0.05


def test_a_capture_that_is_turned_and_in_feet_gives_the_same_points(tmp_path: Path) -> None:
    walked = poses(8)
    upright = read(write_nerfstudio(tmp_path / "upright", walked), scale=1.0)
    turned = read(write_nerfstudio(tmp_path / "turned", walked, Y_UP, unit=2.0), scale=0.5)
    assert not turned.alignment.is_identity
    for a, b, pose in zip(depth_sweeps(upright.depths, 320), depth_sweeps(turned.depths, 320), walked, strict=True):
        # Up is found to within a fraction of a degree.
        assert np.linalg.norm(b.origin - a.origin, axis=-1) < 0.1
        far = np.linalg.norm(a.points - pose[:3, 3], axis=1)
        assert np.allclose(np.linalg.norm(b.points - b.origin, axis=1), far, atol=2e-3)


@pytest.mark.parametrize("kind", ["scans", "merged", "depth"])
def test_the_map_is_that_of_the_room(tmp_path: Path, kind: str) -> None:
    walked = poses(60 if kind == "depth" else 24)  # a camera sees less at a time
    capture = read(write_kapture(tmp_path, walked, merged=kind == "merged", depth=kind == "depth"), camera_height=1.31)
    made = built(capture)
    assert made.provenance.source == ("depth" if kind == "depth" else "lidar")
    assert ("nearest cameras" in made.provenance.note) == (kind == "merged")
    figures = compare_maps(made.occupancy, truth())
    assert figures["occupied_found_free"] == 0 and figures["beside_m2"] == 0
    assert figures["free_found_free"] > 0.985
    assert figures["free_found_occupied"] < 0.001


def test_what_is_stepped_over_or_walked_under_is_free(tmp_path: Path) -> None:
    capture = read(write_kapture(tmp_path, poses(12)))
    rays = find_rays(capture, None)
    on_the_box = np.array([[x, y] for x in (0.7, 0.9, 1.1) for y in (-0.4, 0.0)])
    over = build_occupancy(capture, None, rays, heights=Heights(1.0, 1.5))
    assert (over.occupancy.states_at(on_the_box) == FREE).all()
    assert (build_occupancy(capture, None, rays).occupancy.states_at(on_the_box) != FREE).all()


def test_where_somebody_walked_is_free_whatever_rays_say(tmp_path: Path) -> None:
    capture = read(write_kapture(tmp_path, poses(12)))
    rays = find_rays(capture, None)
    across = [np.array([x, -0.2, 1.31]) for x in np.arange(0.0, 1.9, 0.3)]  # over the box

    def at(position: np.ndarray) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, 3] = position
        return pose

    frames = [replace(frame, camera_to_world=at(place)) for frame, place in zip(capture.frames, across)]
    through = replace(capture, frames=tuple(frames), cloud=None)
    free, rays_alone = (build_occupancy(through, None, rays, walked=walked).occupancy for walked in (0.2, 0.0))
    on_the_box = np.array([0.9, -0.2])
    assert free.states_at(on_the_box) == FREE and rays_alone.states_at(on_the_box) != FREE
    new = free.cells != rays_alone.cells
    beside = np.abs(free.centers()[new][:, 1] + 0.2)
    assert beside.max() < 0.21 and (free.cells[new] == FREE).all()
    assert "0.2 m to either side" in build_occupancy(through, None, rays, walked=0.2).provenance.note
    with pytest.raises(InputError, match="--walked"):
        build_occupancy(through, None, rays, walked=2.0)


def test_several_captures_bring_their_scans_and_depth_images(tmp_path: Path) -> None:
    write_kapture(tmp_path / "a", poses(4))
    write_kapture(tmp_path / "b", poses(5))
    write_list([tmp_path / "a", tmp_path / "b"], tmp_path / "both.captures")
    both = read(tmp_path / "both.captures")
    assert {scan.sensor for scan in both.scans} == {"a/lidar0", "b/lidar0"}
    assert len(scans_with_places(both.scans)) == 9
    left_out = read(write_nerfstudio(tmp_path / "c", poses(4)), scale=1.0, leave_out="images/001.png")
    assert [depth.frame for depth in left_out.depths] == [f"images/00{i}.png" for i in (0, 2, 3)]


def test_a_scanner_that_never_moved_says_nothing_of_its_place(tmp_path: Path) -> None:
    capture = read(write_kapture(tmp_path, poses(4), merged=True))
    assert len(capture.scans) == 1 and scans_with_places(capture.scans) == []


def test_a_depth_camera_without_a_lens_is_left_out_with_a_warning(tmp_path: Path) -> None:
    write_kapture(tmp_path, poses(3), depth=True)
    path = tmp_path / "sensors" / "sensors.txt"
    path.write_text(path.read_text().replace("depth, PINHOLE", "depth, UNKNOWN_CAMERA"))
    findings = Findings()
    assert read_raw(tmp_path, findings).depths == ()
    assert [f.severity for f in findings if "depth0" in f.message] == ["warning"]


@pytest.mark.parametrize("rows", ["1, depth0\n", "now, depth0, 1.depth\n", "\xff\n"])
def test_a_damaged_list_of_depth_images_does_not_refuse_the_capture(tmp_path: Path, rows: str) -> None:
    write_kapture(tmp_path, poses(3), depth=True)
    (tmp_path / "sensors" / "records_depth.txt").write_bytes(f"# kapture format: 1.1\n{rows}".encode("latin-1"))
    findings = Findings()
    assert read_raw(tmp_path, findings).depths == ()
    assert {f.severity for f in findings} == {"warning"}


def damage_raw(folder: Path) -> Path:
    write_kapture(folder, poses(3), depth=True)
    file = folder / "sensors" / "records_data" / "1.depth"
    file.write_bytes(file.read_bytes()[:-4])
    return folder


def damage_image(folder: Path) -> Path:
    path = write_nerfstudio(folder, poses(3))
    assert cv2.imwrite(str(folder / "depth" / "001.png"), np.zeros((48, 64, 3), np.uint8))
    return path


def lose_image(folder: Path) -> Path:
    path = write_nerfstudio(folder, poses(3))
    (folder / "depth" / "002.png").unlink()
    return path


@pytest.mark.parametrize(
    ("damage", "words"), [(damage_raw, "12284 bytes"), (damage_image, "one channel"), (lose_image, "002.png")]
)
def test_a_damaged_depth_image_ends_in_a_sentence(tmp_path: Path, damage: object, words: str) -> None:
    assert callable(damage)
    capture = read(damage(tmp_path), scale=1.0)
    with pytest.raises(InputError, match=words):
        built(capture, "depth")


@pytest.mark.parametrize(
    ("wanted", "words"),
    [("lidar", "no LiDAR scan"), ("auto", "nvsim depth"), ("images", "--project"), ("trained", "--project")],
)
def test_a_capture_without_what_is_wanted_is_refused(tmp_path: Path, wanted: Wanted, words: str) -> None:
    path = write_nerfstudio(tmp_path, poses(3))
    path.write_text(path.read_text().replace("depth_file_path", "depth_file"))
    with pytest.raises(InputError, match=words):
        find_rays(read(path, scale=1.0), None, wanted)


def test_heights_that_no_ray_passes_are_refused(tmp_path: Path) -> None:
    capture = read(write_kapture(tmp_path, poses(3)))
    with pytest.raises(InputError, match="--from-height"):
        build_occupancy(capture, None, find_rays(capture, None), heights=Heights(5.0, 6.0))
    with pytest.raises(InputError, match="--reach"):
        build_occupancy(capture, None, find_rays(capture, None), reach=0.0)
