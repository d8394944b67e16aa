"""360 degree captures: recognized, cut into views, and posed as rigs; or cut with the poses that they bring."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from textured_room import OPENGL, render_panorama, seen

from nvsim.capture.read import read
from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.footage.panoramas import extract_panoramas
from nvsim.footage.sources import is_panoramic, need_footage, says_spherical
from nvsim.footage.views import Views, cut_views, views_of
from nvsim.poses.piece_reliability import Observations
from nvsim.poses.rigs import firmly_connected_panoramas, select_reliable_loops
from nvsim.poses.two_views import TwoViews, from_matches
from nvsim.project.project import Project
from nvsim.project.stages import posed
from nvsim.reconstruction.footage_check import check_footage, footage_at
from nvsim.reconstruction.report import read_report


def along_the_room(count: int = 8, step: float = 0.25, turn: float = 0.4) -> np.ndarray:
    """(count, 4, 4) camera to world of a level camera that walks, turns and sways."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for i, pose in enumerate(poses):
        yaw, tilt = turn * i, 0.05 * np.sin(i)
        ahead = np.array([np.cos(yaw) * np.cos(tilt), np.sin(yaw) * np.cos(tilt), np.sin(tilt)])
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        pose[:3, 3] = [1.5 + step * i, 1.6 + 0.15 * i * step, 1.4 + 0.05 * np.cos(2 * i)]
    return poses


def write_video(path: Path, images: list[np.ndarray], rate: float) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = images[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, (width, height))
    for image in images:
        video.write(image)
    video.release()
    return path


def gray_images(count: int, width: int, height: int) -> list[np.ndarray]:
    return [np.full((height, width, 3), 40 + i, np.uint8) for i in range(count)]


# Cutting --------------------------------------------------------------------------------------------------------------


def test_a_view_shows_the_colors_of_its_directions() -> None:
    height = 512
    longitude = (np.arange(2 * height) + 0.5) / (2 * height) * 2 * np.pi - np.pi
    latitude = np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi
    ray = np.stack(  # right, down, ahead
        np.broadcast_arrays(
            np.sin(longitude) * np.cos(latitude)[:, None],
            -np.sin(latitude)[:, None],
            np.cos(longitude) * np.cos(latitude)[:, None],
        ),
        axis=-1,
    )
    panorama = np.rint(127 + 120 * ray).astype(np.uint8)
    for size in (326, 64):  # as fine as the panorama, and much coarser
        views = Views(4, size)
        at = (np.arange(size) + 0.5) / size * 2 - 1  # 90 degrees
        x, y = np.meshgrid(at, at)
        one, length = np.ones_like(x), np.sqrt(x**2 + y**2 + 1)
        expected = [(x, y, one), (one, y, -x), (-x, y, -one), (-one, y, x)]  # ahead, right, back, left
        for image, direction in zip(cut_views(panorama, views), expected, strict=True):
            colors = 127 + 120 * np.stack(direction, axis=-1) / length[..., None]
            assert np.abs(image - colors).max() < 2.5


def test_masks_are_cut_without_blending() -> None:
    mask = np.zeros((200, 400), np.uint8)
    mask[:, 200:300] = 255  # longitudes 0 to 90 degrees
    ahead, right, back, left = cut_views(mask, Views(4, 60), nearest=True)
    assert set(np.unique(ahead)) == {0, 255}
    assert ahead[:, 32:].all() and not ahead[:, :28].any() and right[:, :28].all() and not right[:, 32:].any()
    assert not back.any() and not left.any()


def test_views_are_as_fine_as_the_panorama_and_not_too_large() -> None:
    assert views_of(2880).size == 960
    size = views_of(960).size
    assert size % 2 == 0 and size / 2 == pytest.approx(960 / np.pi, rel=0.01)  # pixels to the radian
    assert Views(4, 480).focal == pytest.approx(240) and Views(6, 100).focal == pytest.approx(50 * np.sqrt(3))


# Recognition ----------------------------------------------------------------------------------------------------------


def test_a_360_degree_capture_is_recognized_by_names_or_by_proportions(tmp_path: Path) -> None:
    rig = tmp_path / "rig"
    for k in range(4):
        write_video(rig / f"side{k}.mp4", gray_images(3, 96, 96), 2)
    assert need_footage(rig).sides == 4 and is_panoramic(need_footage(rig))
    (rig / "side1.mp4").rename(rig / "kitchen.mp4")
    assert not need_footage(rig).sides and not is_panoramic(need_footage(rig))
    for width, expected in ((512, True), (510, True), (448, False)):
        video = need_footage(write_video(tmp_path / f"{width}.mp4", gray_images(3, width, 256), 2))
        assert is_panoramic(video) is expected
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    for k in range(3):
        cv2.imwrite(str(photographs / f"{k}.jpg"), np.zeros((100, 200, 3), np.uint8))
    found = footage_at(photographs)
    assert found is not None and is_panoramic(found)
    for k in range(3):
        cv2.imwrite(str(photographs / f"{k}.jpg"), np.zeros((100, 150, 3), np.uint8))
    found = footage_at(photographs)
    assert found is not None and not is_panoramic(found)


def test_check_says_why_a_video_is_taken_for_a_panorama(tmp_path: Path) -> None:
    video = write_video(tmp_path / "walk.mp4", gray_images(12, 512, 256), 2)
    said = [f.message for f in check_footage(need_footage(video), True).findings]
    assert any("because they are twice as wide as high" in message for message in said)
    assert not says_spherical(video)
    with open(video, "ab") as file:
        file.write(b"<GSpherical:Spherical>true</GSpherical:Spherical>")
    assert says_spherical(video)
    said = [f.message for f in check_footage(need_footage(video), True).findings]
    assert any("by their metadata" in message for message in said)


@pytest.mark.parametrize(
    ("counts", "size", "said"),
    [
        ((4, 4, 3), (96, 96), "side2.mp4 has 3 frames"),
        ((3, 3, 3), (128, 96), "the sides of a 360 degree rig are square"),
    ],
)
def test_sides_that_do_not_fit_together_are_one_sentence(
    tmp_path: Path, counts: tuple[int, ...], size: tuple[int, int], said: str
) -> None:
    for k, count in enumerate(counts):
        write_video(tmp_path / f"side{k}.mp4", gray_images(count, *size), 2)
    with pytest.raises(InputError, match=said):
        extract_panoramas(need_footage(tmp_path), tmp_path / "out")
    assert check_footage(need_footage(tmp_path), True).refused


def test_a_photograph_of_other_proportions_is_one_sentence(tmp_path: Path) -> None:
    for k, width in enumerate((200, 200, 150)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((100, width, 3), np.uint8))
    with pytest.raises(InputError, match="2.png is 150x100 pixels"):
        extract_panoramas(need_footage(tmp_path), tmp_path / "out")


# Choosing and posing --------------------------------------------------------------------------------------------------


def test_panoramas_are_chosen_by_motion_and_seldom_by_turning(tmp_path: Path) -> None:
    path = along_the_room(12, 0.03, 0.02)
    still = np.repeat(path[-1:], 7, axis=0)
    for k, pose in enumerate(still):
        pose[:3, :3] = cv2.Rodrigues(np.array([0, 0, 0.2 * k]))[0] @ pose[:3, :3]  # 11 degrees each
    images = [render_panorama(pose) for pose in (*path, *still)]
    chosen = extract_panoramas(need_footage(write_video(tmp_path / "walk.mp4", images, 6)), tmp_path / "out")
    numbers = [int(name[2:8]) for name in chosen.names]
    assert chosen.looked_at == len(images) and numbers[0] == 0
    assert 3 <= sum(number < 12 for number in numbers) <= 8 and sum(number > 12 for number in numbers) <= 2
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"side0", "side1", "side2", "side3", "frames.json"}
    view = cv2.imread(str(tmp_path / "out" / "side2" / chosen.names[1]))
    at = (np.arange(view.shape[0]) + 0.5) / view.shape[0] * 2 - 1
    x, y = np.meshgrid(at, at)
    behind = seen(path[numbers[1]], np.stack([-x, y, -np.ones_like(x)], axis=-1))
    assert np.abs(view.astype(int) - behind).mean() < 12


def test_panoramas_get_the_poses_of_a_rig(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    truth, out = along_the_room(), tmp_path / "out"
    video = write_video(tmp_path / "walk.mp4", [render_panorama(pose, 320) for pose in truth], 2)
    assert main(["poses", str(video), "--out", str(out)]) == 0
    assert "read as a 360 degree panorama" in capsys.readouterr().err
    report = read_report(out)
    assert report is not None and (report.with_pose, report.frames, report.views) == (8, 8, 4)
    capture = read(out, scale=1.0)
    assert len(capture.frames) == 32
    by_name = {f.name: f.camera_to_world for f in capture.frames}
    found = np.array([by_name[f"side0/0_{i:06d}.jpg"] for i in range(8)])
    for i in range(8):  # the views of a panorama share its center, and turn to the right
        right = by_name[f"side1/0_{i:06d}.jpg"]
        assert np.allclose(right[:3, 3], found[i, :3, 3], atol=1e-6)
        assert np.allclose(right[:3, 2], found[i, :3, 0], atol=1e-5)
    length = np.linalg.norm(truth[-1, :3, 3] - truth[0, :3, 3])
    scale = length / np.linalg.norm(found[-1, :3, 3] - found[0, :3, 3])
    for i in range(8):  # all relative to the first
        mine, own = np.linalg.inv(found[0]) @ found[i], np.linalg.inv(truth[0]) @ truth[i]
        assert np.linalg.norm(scale * mine[:3, 3] - own[:3, 3]) < 0.02 * length
        assert np.degrees(np.arccos(np.clip((np.trace(mine[:3, :3].T @ own[:3, :3]) - 1) / 2, -1, 1))) < 0.5


def test_panoramas_without_texture_are_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    video = write_video(tmp_path / "walk.mp4", gray_images(6, 512, 256), 2)
    assert main(["poses", str(video), "--out", str(tmp_path / "out")]) == 2
    said = [line for line in capfd.readouterr().err.splitlines() if "too little in common" in line]
    assert len(said) == 1 and not (tmp_path / "out" / "sparse").exists()


@pytest.mark.parametrize(("across", "pieces"), [(1, [12, 8]), (60, [20])])
def test_a_walk_that_few_points_hold_together_is_cut(across: int, pieces: list[int]) -> None:
    rng = np.random.default_rng(0)
    centers = np.column_stack([np.arange(20) * 0.4, np.zeros(20), np.zeros(20)])
    turns = Views(4, 480).turns
    near = [rng.uniform((0, -2, -1), (4.4, 2, 1), (150, 3)), rng.uniform((4.8, -2, -1), (7.6, 2, 1), (150, 3))]
    both = rng.uniform((3, -2, -1), (6, 2, 1), (across, 3))
    points = np.concatenate([*near, both])
    image, point = [], []
    for k, center in enumerate(centers):
        shown = [*range(150 * (k >= 12), 150 * (k >= 12) + 150), *range(300, 300 + across)]
        for n in shown:
            local = turns @ (points[n] - center)
            image.append(4 * k + int(np.argmax(local[:, 2] - np.abs(local[:, 0]))))
            point.append(n)
    rotation, center = np.tile(turns, (20, 1, 1)), np.repeat(centers, 4, axis=0)
    seen = Observations(
        np.arange(1, 81), rotation, center, np.full(80, 240.0), np.array(image), np.array(point), points
    )
    found = firmly_connected_panoramas(seen, np.repeat(np.arange(20), 4))
    assert [len(piece) for piece in found] == pieces and found[0][0] == 0


def test_a_loop_needs_another_one_beside_it_with_the_same_rotation() -> None:
    def turned(degrees: float, matches: int) -> TwoViews:
        found = from_matches(np.zeros((matches, 2), np.uint32))
        return replace(found, rotation=cv2.Rodrigues(np.array([0, np.radians(degrees), 0]))[0])

    chain = {(i, i + 1): turned(5, 200) for i in range(60)}  # 5 degrees a step
    loops = {
        (0, 40): turned(200.5, 50),
        (2, 41): turned(194.0, 50),  # 39 steps
        (10, 58): turned(240, 60),  # alone
        (25, 50): turned(125, 60),
        (26, 52): turned(160, 60),  # 26 steps are 130 degrees
        (5, 30): turned(100, 400),  # alone, and with very many matches
    }
    assert set(select_reliable_loops(loops, chain)) == {(0, 40), (2, 41), (5, 30)}


# Given poses ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def given(tmp_path: Path) -> Path:
    """Three panoramas of the room with poses, and a mask of the first."""
    folder, frames = tmp_path / "given", []
    (folder / "images").mkdir(parents=True)
    for i, pose in enumerate(along_the_room(3)):
        cv2.imwrite(str(folder / "images" / f"{i}.png"), render_panorama(pose)[..., ::-1])
        frames.append({"file_path": f"images/{i}.png", "transform_matrix": (pose @ OPENGL).tolist()})
    mask = np.full((256, 512), 255, np.uint8)
    mask[:, :256] = 0  # everything to the left
    cv2.imwrite(str(folder / "mask.png"), mask)
    frames[0]["mask_path"] = "mask.png"
    listed = {"camera_model": "EQUIRECTANGULAR", "w": 512, "h": 256, "unit": "meter", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(listed))
    return folder


def test_posed_panoramas_become_views_with_poses_and_lenses(given: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["poses", str(given), "--out", str(out)]) == 0
    capture = read(out)
    assert len(capture.frames) == 12
    truth = along_the_room(3)
    for frame in capture.frames:
        number = int(Path(frame.name).stem)
        size, focal = frame.lens.width, frame.lens.focal[0]
        at = (np.arange(size) + 0.5 - size / 2) / focal
        x, y = np.meshgrid(at, at)
        # What a camera at the pose that was read sees, in the world of the room.
        pose = truth[number].copy()
        pose[:3, :3] = frame.camera_to_world[:3, :3]
        assert np.allclose(frame.camera_to_world[:3, 3], truth[number][:3, 3], atol=1e-6)
        expected = seen(pose, np.stack([x, y, np.ones_like(x)], axis=-1))
        image = cv2.imread(str(frame.image_path))[..., ::-1].astype(int)
        assert np.abs(image - expected).mean() < 12
    masks = {f.name: cv2.imread(str(f.mask.path), 0) for f in capture.frames if f.mask is not None}
    assert len(masks) == 4
    assert next(m for n, m in masks.items() if "side1" in n).all()
    assert not next(m for n, m in masks.items() if "side3" in n).any()


def test_a_project_cuts_posed_panoramas_by_itself(given: Path, tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        folder = posed.run(project, given, lambda event: None)
        assert folder == project.layout.poses(1) and len(read(folder).frames) == 12
        written = (folder / "images" / "side0" / "0.jpg").stat().st_mtime_ns
        assert posed.run(project, given / "transforms.json", lambda event: None) == folder
        assert (folder / "images" / "side0" / "0.jpg").stat().st_mtime_ns == written
        cv2.imwrite(str(given / "images" / "2.png"), np.zeros((256, 512, 3), np.uint8))
        assert posed.run(project, given, lambda event: None) == project.layout.poses(2)


def test_check_names_the_command_for_posed_panoramas(given: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["check", str(given)]) == 0
    assert f"nvsim run {given}" in capsys.readouterr().out
    assert main(["check", str(given), "--json"]) == 0
    assert not json.loads(capsys.readouterr().out)["refused"]
    with pytest.raises(InputError, match="nvsim poses FILE --out FOLDER"):
        read(given)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"file_path": ""}, "frame 0: the field 'file_path' is missing"),
        ({"file_path": "images/9.png"}, "9.png"),
        ({"file_path": "square.png"}, "the image is 100x100 pixels"),
        ({"transform_matrix": [[1]]}, "'transform_matrix' is not a 4x4 matrix"),
        ({"transform_matrix": None}, "'transform_matrix' is not a 4x4 matrix"),
        ({"mask_path": "gone.png"}, "gone.png"),
    ],
)
def test_damaged_posed_panoramas_are_one_sentence(
    given: Path, tmp_path: Path, change: dict[str, object], said: str, capsys: pytest.CaptureFixture
) -> None:
    cv2.imwrite(str(given / "square.png"), np.zeros((100, 100, 3), np.uint8))
    tree = json.loads((given / "transforms.json").read_text())
    tree["frames"][0] |= change
    (given / "transforms.json").write_text(json.dumps(tree))
    assert main(["poses", str(given), "--out", str(tmp_path / "out")]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "%" not in line]
    assert len(lines) == 1 and said in lines[0]


def test_an_interrupted_cut_continues_and_other_captures_stay(given: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    image = (given / "images" / "2.png").read_bytes()
    (given / "images" / "2.png").write_bytes(image[:50])
    assert main(["poses", str(given), "--out", str(out)]) == 2
    assert not (out / "transforms.json").exists()
    (given / "images" / "2.png").write_bytes(image)
    assert main(["poses", str(given), "--out", str(out)]) == 0
    assert (out / "transforms.json").exists()
    (tmp_path / "other" / "images").mkdir(parents=True)
    assert main(["poses", str(given), "--out", str(tmp_path / "other")]) == 2
    assert list((tmp_path / "other").iterdir()) == [tmp_path / "other" / "images"]
