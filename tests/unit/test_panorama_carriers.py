"""The carrier of a 360 degree camera is found and masked in all views; panoramas are cut into more views on request."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_panoramas import along_the_room, gray_images, write_video
from textured_room import OPENGL, SIZE, render_panorama

from nvsim.capture.read import read
from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.footage.carrier import PanoramaSamples, read_panorama_mask
from nvsim.footage.cut_options import cut_options
from nvsim.footage.panoramas import extract_panoramas
from nvsim.footage.sources import need_footage
from nvsim.footage.views import Views, covered_pixels, cut_views, join, nearest_pixels, views_of
from nvsim.project.config import CaptureConfig
from nvsim.project.project import Project
from nvsim.project.stages import posed
from nvsim.reconstruction.report import read_report, rows

ROWS = 360


def directions(height: int) -> tuple[np.ndarray, np.ndarray]:
    """(height, 2 * height) longitudes and latitudes in degrees."""
    return np.meshgrid(
        (np.arange(2 * height) + 0.5) / height * 180 - 180, 90 - (np.arange(height) + 0.5) / height * 180
    )


def body(height: int, sway: float, moment: int) -> np.ndarray:
    """(height, 2 * height) bool: a person behind the camera, from straight down up to 17 degrees below the horizon, who
    sways by up to `sway` times 1.5 degrees."""
    longitude, latitude = directions(height)
    aside = (longitude - 150 - 1.5 * sway * np.sin(1.3 * moment) + 180) % 360 - 180
    above = latitude - 0.8 * sway * np.sin(2.1 * moment + 1)
    torso = (np.abs(aside) < 14 + 10 * np.clip((-above - 30) / 25, 0, 1)) & (above < -30)
    return torso | ((aside / 7) ** 2 + ((above + 26) / 9) ** 2 < 1) | (above < -72)


def clothes(height: int, kind: str) -> np.ndarray:
    """(height, 2 * height, 3) uint8: blobs of so many degrees, or one gray."""
    if kind.endswith("degrees"):
        coarse = round(180 / float(kind.split()[0]))
        noise = np.random.default_rng(0).integers(20, 200, (coarse, 2 * coarse, 3)).astype(np.uint8)
        return cv2.resize(noise, (2 * height, height), interpolation=cv2.INTER_CUBIC)
    return np.full((height, 2 * height, 3), {"dark": 40, "light": 200}[kind], np.uint8)


def carried(panorama: np.ndarray, moment: int, kind: str = "4 degrees", sway: float = 0.7) -> np.ndarray:
    height = panorama.shape[0]
    degree = height / 180
    shift = round(-0.8 * sway * np.sin(2.1 * moment + 1) * degree), round(1.5 * sway * np.sin(1.3 * moment) * degree)
    moved = np.roll(clothes(height, kind), shift, (0, 1))
    return np.where(body(height, sway, moment)[..., None], moved, panorama)


def overlap(usable: np.ndarray | None, count: int, sway: float, seen: np.ndarray) -> tuple[float, float]:
    """Intersection over union, and the share of the usual body that is masked, by solid angle."""
    assert usable is not None
    usual = np.median([body(ROWS, sway, moment) for moment in range(count)], axis=0) > 0.5
    weight = np.cos(np.radians(directions(ROWS)[1])) * seen
    both = float(weight[usual & ~usable].sum())
    return both / float(weight[usual | ~usable].sum()), both / float(weight[usual].sum())


# Views ----------------------------------------------------------------------------------------------------------------


def test_the_second_ring_looks_down_and_the_third_up() -> None:
    for count, expected in ((4, [0]), (8, [0, -45]), (12, [0, -45, 45])):
        views = views_of(1000, count)
        assert (
            views.count == count == len(views.names("a.jpg")) and views.names("a.jpg")[-1] == f"side{count - 1}/a.jpg"
        )
        ahead = views.turns[:, 2]  # right, down, ahead
        assert np.allclose(np.degrees(np.arcsin(-ahead[:, 1])), np.repeat(expected, 4))
        assert np.allclose(
            np.degrees(np.arctan2(ahead[:, 0], ahead[:, 2])) % 360, np.tile([0, 90, 180, 270], count // 4)
        )
        assert np.allclose(views.turns @ views.turns.transpose(0, 2, 1), np.eye(3))
        assert np.allclose(np.linalg.det(views.turns), 1) and np.allclose(views.turns[:, 0, 1], 0)  # level sideways


def test_views_join_to_the_panorama_they_were_cut_from() -> None:
    panorama = render_panorama(along_the_room(1)[0], 400)
    smooth = cv2.GaussianBlur(panorama, (0, 0), 3)
    for count, share in ((4, 0.67), (12, 1.0)):
        views = views_of(800, count)
        again, seen = join(cut_views(smooth, views), views, 400), covered_pixels(views, 400)
        weight = np.cos(np.radians(directions(400)[1]))
        assert weight[seen].sum() / weight.sum() == pytest.approx(share, abs=0.01)
        assert np.abs(again[seen].astype(int) - smooth[seen]).mean() < 1 and not again[~seen].any()


def test_each_direction_belongs_to_one_view() -> None:
    assert all(own.all() for own in nearest_pixels(Views(4, 60)))
    views = views_of(1500, 12)
    across, down = np.meshgrid(*[(np.arange(views.size) + 0.5 - views.size / 2) / views.focal] * 2)
    solid = (1 + across**2 + down**2) ** -1.5 / views.focal**2
    assert sum(float(solid[own].sum()) for own in nearest_pixels(views)) == pytest.approx(4 * np.pi, rel=0.005)


@pytest.mark.parametrize("views", [0, 1, 5, 6, -4, 100])
def test_other_numbers_of_views_are_one_sentence(views: int, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["poses", str(tmp_path), "--out", str(tmp_path / "out"), "--views", str(views)]) == 2
    assert f"cannot be cut into {views} views; --views is 4 (level), 8" in capsys.readouterr().err


# Finding the carrier --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def house(shared_data: Path) -> list[list[np.ndarray]]:
    """The four sides of every sixth panorama of a rendered house, in which nothing carries the camera."""
    videos = [cv2.VideoCapture(str(shared_data / "house_360" / f"side{k}.mp4")) for k in range(4)]
    moments = []
    while all(video.grab() for video in videos):
        moments.append([video.retrieve()[1] for video in videos])
    return moments[::6]


def test_nothing_is_masked_in_a_house_without_a_carrier(house: list[list[np.ndarray]]) -> None:
    samples = PanoramaSamples(Views(4, 480))
    for sides in house:
        samples.add(sides)
    assert samples.usable() is None


@pytest.mark.parametrize("kind", ["4 degrees", "2 degrees", "dark", "light"])
def test_a_carrier_is_found_in_a_house(house: list[list[np.ndarray]], kind: str) -> None:
    views, samples = Views(4, 480), PanoramaSamples(Views(4, 480))
    for moment, sides in enumerate(house):
        painted = cut_views(carried(np.zeros((720, 1440, 3), np.uint8), moment, kind, 1.0), views)
        where = cut_views(255 * body(720, 1.0, moment).astype(np.uint8), views, nearest=True)
        samples.add([np.where(w[..., None] > 0, p, side) for side, p, w in zip(sides, painted, where, strict=True)])
    union, masked = overlap(samples.usable(), len(house), 1.0, covered_pixels(views, ROWS))
    assert union > 0.8 and masked > 0.95


def over_a_floor(pose: np.ndarray, floor: str) -> np.ndarray:
    """(256, 512, 3) of the room: with noise on its floor, or one color that changes a little from wall to wall."""
    panorama = render_panorama(pose)
    if floor == "plain":
        longitude, latitude = np.radians(directions(256))
        level = np.cos(latitude)
        rays = np.stack([level * np.sin(longitude), -np.sin(latitude), level * np.cos(longitude)], axis=-1)
        rays = rays @ pose[:3, :3].T
        reach = np.where(rays > 0, SIZE - pose[:3, 3], -pose[:3, 3]) / rays
        is_floor = (reach.argmin(axis=-1) == 2) & (rays[..., 2] < 0)
        x, y, _ = (pose[:3, 3] + rays * reach.min(axis=-1)[..., None])[is_floor].T
        noise = np.random.default_rng(int(1000 * x.sum()) % 2**32).normal(0, 2, len(x))
        panorama[is_floor] = np.clip(130 + 8 * np.sin(x) + 6 * np.cos(1.3 * y) + noise, 0, 255)[:, None]
    return panorama


@pytest.mark.parametrize("floor", ["noise", "plain"])
def test_a_carrier_is_found_down_to_its_feet(floor: str) -> None:
    path = along_the_room(30, 0.1, 0.2)
    empty, full = PanoramaSamples(), PanoramaSamples()
    for moment, pose in enumerate(path):
        panorama = over_a_floor(pose, floor)
        empty.add(panorama)
        full.add(carried(cv2.resize(panorama, (2 * ROWS, ROWS)), moment))
    assert empty.usable() is None
    union, masked = overlap(full.usable(), len(path), 0.7, np.ones((ROWS, 2 * ROWS), bool))
    assert union > 0.8 and masked > 0.95


def test_a_camera_that_stands_still_is_no_carrier() -> None:
    samples = PanoramaSamples()
    pose = along_the_room(1)[0]
    noise = np.random.default_rng(0)
    panorama = render_panorama(pose)
    for _ in range(20):
        samples.add(np.clip(panorama + noise.normal(0, 3, panorama.shape), 0, 255).astype(np.uint8))
    assert samples.usable() is None


def test_few_panoramas_are_kept_in_memory() -> None:
    samples = PanoramaSamples()
    for k in range(1000):
        samples.add(np.full((64, 128, 3), k % 256, np.uint8))
    kept = [int(panorama[0, 0]) for panorama in samples._kept]
    assert 24 <= len(kept) <= 48 and kept == [(32 * k) % 256 for k in range(len(kept))]


# From footage to masks ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk through the room with a carrier."""
    images = [carried(render_panorama(pose, 320), k) for k, pose in enumerate(along_the_room(14, 0.2, 0.3))]
    return write_video(tmp_path_factory.mktemp("carried") / "walk.mp4", images, 2)


def test_the_carrier_is_masked_has_no_features_and_the_number_of_views_is_kept(
    video: Path, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    out = tmp_path / "out"
    words = ["poses", str(video), "--out", str(out)]
    assert main(words) == 0
    four = read_report(out)
    assert four is not None and (four.views, four.with_pose) == (4, 14) and 1 < four.masked < 15
    assert "the carrier of the camera" in rows(four)["Masked"]
    assert main([*words, "--views", "8"]) == 0
    eight = read_report(out)
    assert eight is not None and (eight.views, eight.with_pose) == (8, 14) and eight.masked > four.masked
    capfd.readouterr()
    assert main(words) == 0
    assert "are up to date" in capfd.readouterr().err and read_report(out) == eight
    capture = read(out, scale=1.0)
    assert len(capture.frames) == 8 * 14
    masked = {f.name: cv2.imread(str(f.mask.path), 0) > 0 for f in capture.frames if f.mask is not None}
    assert {name.partition("/")[0] for name in masked} >= {"side4", "side5", "side6", "side7"}
    assert not any(name.startswith(("side0/", "side3/")) for name in masked)  # the carrier is behind to the right
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(out / "sparse" / "0")
    for image in model.images.values():
        for point in image.points2D if image.name in masked else ():
            x, y = np.floor(point.xy).astype(int)
            assert masked[image.name][y, x]


def test_another_number_of_views_leaves_no_image_of_the_one_before(video: Path, tmp_path: Path) -> None:
    footage = need_footage(video)
    for count in (8, 4):
        found = extract_panoramas(footage, tmp_path / "images", cut_options(count, ""))
        assert len(found.masks) == found.views.count == count
        for folder in ("images", "masks"):
            sides = {p.name for p in (tmp_path / folder).glob("side*")}
            assert sides <= {f"side{k}" for k in range(count)} and (folder == "masks" or len(sides) == count)
    read_again = extract_panoramas(footage, tmp_path / "images", cut_options(4, ""), lambda done, total: pytest.fail())
    assert read_again.names == found.names and np.array_equal(read_again.masks, found.masks)


def test_a_given_mask_is_used_in_place_of_the_one_that_is_found(
    video: Path, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    mask, out = np.full((100, 200), 255, np.uint8), tmp_path / "out"
    mask[:, :50] = 0  # the back left quarter
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    assert main(["poses", str(video), "--out", str(out), "--mask", str(tmp_path / "mask.png")]) == 0
    report = read_report(out)
    assert report is not None and report.masked == pytest.approx(25, abs=0.5)
    assert str(tmp_path / "mask.png") in rows(report)["Masked"]
    assert {p.name for p in (out / "masks").iterdir()} == {"side2", "side3", "panorama.png"}
    own = out / "masks" / "panorama.png"
    assert np.array_equal(read_panorama_mask(own), mask > 0)
    assert main(["poses", str(video), "--out", str(out), "--mask", str(own)]) == 2
    assert "copy it elsewhere and use the copy" in capfd.readouterr().err and own.exists()


def test_the_options_are_for_panoramas_alone(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    ordinary = write_video(tmp_path / "walk.mp4", gray_images(6, 320, 240), 6)
    for k in range(4):
        write_video(tmp_path / "rig" / f"side{k}.mp4", gray_images(3, 96, 96), 2)
    (tmp_path / "mask.png").write_bytes(bytes(cv2.imencode(".png", np.full((64, 128), 255, np.uint8))[1]))
    square, black = tmp_path / "square.png", tmp_path / "black.png"
    cv2.imwrite(str(square), np.full((64, 64), 255, np.uint8))
    cv2.imwrite(str(black), np.zeros((64, 128), np.uint8))
    panoramic = write_video(tmp_path / "360.mp4", gray_images(6, 512, 256), 2)
    for source, options, said in (
        (ordinary, ["--views", "4"], "is not a 360 degree capture"),
        (ordinary, ["--mask", str(tmp_path / "mask.png")], "is not a 360 degree capture"),
        (tmp_path / "rig", ["--views", "4"], "are the views of a 360 degree rig already"),
        (panoramic, ["--mask", str(tmp_path / "none.png")], "none.png: it does not exist"),
        (panoramic, ["--mask", str(square)], "a mask of a panorama is twice as wide as high"),
        (panoramic, ["--mask", str(black)], "is all black"),
    ):
        assert main(["poses", str(source), "--out", str(tmp_path / "out"), *options]) == 2
        lines = [line for line in capfd.readouterr().err.splitlines() if said in line]
        assert len(lines) == 1
        assert not (tmp_path / "out" / "images").exists()
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        (tmp_path / "capture").mkdir()
        with pytest.raises(InputError, match="not a 360 degree capture"):
            posed.run(project, tmp_path / "capture", lambda event: None, options=cut_options(8, ""))


def test_the_options_change_the_key_of_an_import_only_if_they_are_given() -> None:
    assert not {"views", "mask"} & set(CaptureConfig().key["CaptureConfig"])
    assert CaptureConfig(views=8).key["CaptureConfig"]["views"] == 8


# Given poses ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def given(tmp_path: Path) -> Path:
    """Panoramas of the room with poses and a carrier; the first has a mask of its own."""
    folder, frames = tmp_path / "given", []
    (folder / "images").mkdir(parents=True)
    for i, pose in enumerate(along_the_room(14, 0.2, 0.3)):
        cv2.imwrite(str(folder / "images" / f"{i}.png"), carried(render_panorama(pose), i))
        frames.append({"file_path": f"images/{i}.png", "transform_matrix": (pose @ OPENGL).tolist()})
    mask = np.full((256, 512), 255, np.uint8)
    mask[:, :128] = 0  # the back left quarter
    cv2.imwrite(str(folder / "mask.png"), mask)
    frames[0]["mask_path"] = "mask.png"
    listed = {"camera_model": "EQUIRECTANGULAR", "unit": "meter", "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(listed))
    return folder


def test_posed_panoramas_are_masked_in_as_many_views_as_wanted(given: Path, tmp_path: Path) -> None:
    with Project.create_or_open(tmp_path / "house.nvsim") as project:
        eight = posed.run(project, given, lambda event: None, options=cut_options(8, ""))
        assert posed.run(project, given, lambda event: None) == eight == project.layout.poses(1)
        four = posed.run(project, given, lambda event: None, options=cut_options(4, ""))
        assert four == project.layout.poses(2)
        assert posed.run(project, given, lambda event: None, options=cut_options(8, "")) == eight
    frames = read(eight).frames
    assert len(frames) == 8 * 14 and len(read(four).frames) == 4 * 14
    assert {f.name.split("/")[1] for f in frames[4::8]} == {f"side{k}" for k in range(8)}  # those that are held out
    masks = {f.name: cv2.imread(str(f.mask.path), 0) > 0 for f in frames if f.mask is not None}
    behind, left = masks["images/side6/1.jpg"], masks["images/side3/1.jpg"]
    expected = cut_views(255 * body(ROWS, 0, 0).astype(np.uint8), views_of(256, 8), nearest=True)[6] > 0
    assert (expected & ~behind).sum() > 0.75 * (expected | ~behind).sum() and left.all()
    own = masks["images/side3/0.jpg"]
    assert not own[:, : own.shape[1] // 2 - 2].any() and own[: own.shape[0] // 4, own.shape[1] // 2 + 2 :].all()
    assert not (masks["images/side6/0.jpg"] & ~behind).any()


def test_posed_panoramas_take_a_given_mask(given: Path, tmp_path: Path) -> None:
    out, words = tmp_path / "out", ["poses", str(given), "--out", str(tmp_path / "out")]
    assert main(words) == 0
    cv2.imwrite(str(tmp_path / "white.png"), np.full((64, 128), 255, np.uint8))
    assert main([*words, "--views", "12", "--mask", str(tmp_path / "white.png")]) == 0
    frames = read(out).frames
    assert len(frames) == 12 * 14
    ignored = {f.name for f in frames if f.mask is not None and not cv2.imread(str(f.mask.path), 0).all()}
    assert ignored and all(name.endswith("/0.jpg") for name in ignored)  # its own mask
