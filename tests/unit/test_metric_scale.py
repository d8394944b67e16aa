"""Recorded positions give the scale of poses if they say enough, and a reason if they do not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from capture_samples import room, walk, write_colmap
from test_position_logs import HEADER, photograph

from nvsim.footage.position_logs import CameraPositions
from nvsim.footage.sources import find_footage
from nvsim.geometry.rotation import matrix_from_quaternion
from nvsim.reconstruction.metric_scale import fit_similarity, judge, with_measured_scales
from nvsim.reconstruction.report import MeasuredScale, PosesReport, read_report, rows, write_report

SCALE = 2.5  # meters per unit of the poses


def path_of(length: float, count: int, seed: int = 0) -> np.ndarray:
    """(count, 3) meters: round a block whose sides are a quarter of `length`, at the height of a hand."""
    t = np.linspace(0, 4, count, endpoint=False)
    x = np.interp(t, [0, 1, 2, 3, 4], [0, 1, 1, 0, 0])
    y = np.interp(t, [0, 1, 2, 3, 4], [0, 0, 1, 1, 0])
    wobble = np.random.default_rng(seed).normal(0, 0.02, count)
    return np.column_stack([length / 4 * x, length / 4 * y, 1.5 + wobble])


def poses_of(places: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """(N, 4, 4) level cameras at `places` in units of the poses, in a frame that is turned by `rotation`."""
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    for k, pose in enumerate(poses):
        heading = 0.3 * k
        ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
        right = np.cross(ahead, [0, 0, 1.0])
        pose[:3, :3] = rotation @ np.stack([right, np.cross(ahead, right), ahead], axis=1)
        pose[:3, 3] = rotation @ places[k] / SCALE
    return poses


def slow_noise(count: int, meters: float, seed: int) -> np.ndarray:
    """(count, 3) horizontal errors that change slowly, as those of GPS do: each keeps 95 % of the one before."""
    dice, found = np.random.default_rng(seed), np.zeros((count, 3))
    now = dice.normal(0, meters, 2)
    for k in range(count):
        found[k, :2] = now
        now = 0.95 * now + np.sqrt(1 - 0.95**2) * dice.normal(0, meters, 2)
    return found


def gps(places: np.ndarray, error: float = 5.0) -> CameraPositions:
    return CameraPositions("GPS", True, tuple(map(str, range(len(places)))), places * [1, 1, 0], error)


def ar(places: np.ndarray) -> CameraPositions:
    return CameraPositions("the log", False, tuple(map(str, range(len(places)))), places, 0.05)


TURNED = matrix_from_quaternion([0.8, 0.3, -0.4, 0.2])


# The fit --------------------------------------------------------------------------------------------------------------


def test_the_similarity_of_exact_points_is_exact() -> None:
    source = np.random.default_rng(2).normal(size=(40, 3))
    target = SCALE * source @ TURNED.T + [5, -3, 1]
    fit = fit_similarity(source, target, 0.01)
    assert fit.scale == pytest.approx(SCALE, rel=1e-9) and fit.rotation == pytest.approx(TURNED, abs=1e-9)
    assert fit.agrees.all() and fit.residual < 1e-9


def test_two_fifths_of_wrong_points_change_nothing() -> None:
    dice = np.random.default_rng(3)
    source = dice.normal(size=(100, 3))
    target = SCALE * source @ TURNED.T
    wrong = dice.permutation(100)[:40]
    target[wrong] += dice.normal(0, 20, (40, 3))
    fit = fit_similarity(source, target, 0.01)
    assert fit.scale == pytest.approx(SCALE, rel=1e-6)
    assert not fit.agrees[wrong].any() and fit.agrees.sum() == 60


def test_the_uncertainty_is_that_of_repeated_trials() -> None:
    places = path_of(400, 160)
    found = [fit_similarity(places / SCALE, places + slow_noise(160, 3.0, seed), 0.1) for seed in range(30)]
    spread = float(np.std([fit.scale for fit in found])) / SCALE
    told = float(np.median([fit.uncertainty for fit in found]))
    assert 0.5 * spread < told < 3 * spread, (told, spread)


# What says enough -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("upright", [True, False])
def test_a_log_of_arkit_gives_the_scale_and_up(upright: bool) -> None:
    rotation = np.eye(3) if upright else TURNED
    places = path_of(20, 60)
    noisy = places + np.random.default_rng(1).normal(0, 0.01, places.shape)
    noisy[7] += 3.0  # tracking was lost
    found = judge(poses_of(places, rotation), ar(noisy), upright)
    assert not found.refused and found.scale == pytest.approx(SCALE, rel=0.005)
    assert found.uncertainty == 2.0 and found.agreeing == 59 and found.residual_m < 0.03
    if upright:
        assert found.up == ()
    else:
        assert np.degrees(np.arccos(min(1.0, float(rotation[:, 2] @ found.up)))) < 0.5


def test_a_straight_corridor_gives_the_scale_but_not_up() -> None:
    places = np.column_stack([np.linspace(0, 15, 50), np.zeros(50), np.full(50, 1.5)])
    found = judge(poses_of(places, TURNED), ar(places + np.random.default_rng(1).normal(0, 0.02, (50, 3))), False)
    assert found.scale == pytest.approx(SCALE, rel=0.01) and found.up == ()


def test_a_large_outdoor_path_gets_its_scale_from_gps() -> None:
    errors = []
    for seed in range(12):
        places = path_of(600, 200, seed)
        found = judge(poses_of(places, TURNED), gps(places + slow_noise(200, 4.0, seed)), False)
        assert not found.refused, found.refused
        errors.append(abs(found.scale / SCALE - 1))
        assert found.uncertainty <= 5 and found.up == ()
    assert max(errors) < 0.05 and np.median(errors) < 0.025


@pytest.mark.parametrize(("length", "meters"), [(8, 5.0), (20, 5.0), (40, 5.0), (40, 20.0), (0.5, 5.0)])
def test_a_short_indoor_walk_gets_no_scale_from_gps(length: float, meters: float) -> None:
    for seed in range(6):
        places = path_of(length, 80, seed)
        for noise in (slow_noise(80, meters, seed), np.random.default_rng(seed).normal(0, meters, (80, 3))):
            found = judge(poses_of(places, TURNED), gps(places + noise), False)
            assert found.refused, found
            assert found.scale == 0


def test_gps_that_stays_at_one_place_indoors_is_refused() -> None:
    places = path_of(300, 80)
    still = np.zeros((80, 3)) + [1.0, 2.0, 0.0]
    assert "1 different positions" in judge(poses_of(places, np.eye(3)), gps(still), True).refused
    assert "spread" in judge(poses_of(places, np.eye(3)), gps(still + slow_noise(80, 5.0, 0)), True).refused


def test_a_stated_error_of_gps_counts() -> None:
    places = path_of(600, 100)
    assert not judge(poses_of(places, np.eye(3)), gps(places, 3.0), True).refused
    refused = judge(poses_of(places, np.eye(3)), gps(places, 65.0), True).refused
    assert "spread by 87 m" in refused and "7 times the error of a position (65 m)" in refused


def test_a_log_of_another_recording_is_refused() -> None:
    for seed in range(10):
        dice = np.random.default_rng(seed)
        other = np.cumsum(dice.normal(0, 0.3, (60, 3)), axis=0)
        assert judge(poses_of(path_of(20, 60), TURNED), ar(other), False).refused


def test_half_of_the_positions_are_not_enough() -> None:
    places = path_of(20, 60)
    noisy = places.copy()
    noisy[::5] += np.random.default_rng(0).normal(0, 4, (12, 3))
    noisy[1::5] += np.random.default_rng(1).normal(0, 4, (12, 3))
    assert "60 % of the positions" in judge(poses_of(places, TURNED), ar(noisy), False).refused


# In a report ----------------------------------------------------------------------------------------------------------


def report_of(source: Path, **changes: object) -> PosesReport:
    whole = PosesReport(
        str(source), "a video", (), 2, 40, 12, 0, 12, (12,), (210.0,), (320, 240), 0.5, 3, (), 2.0, upright=(True,)
    )
    return replace(whole, **changes)  # type: ignore[arg-type]


def filmed(folder: Path) -> Path:
    """A video whose poses are those of the small room: frames 0, 5, 10, ... of it."""
    poses = walk(12)
    write_colmap(folder / "poses", poses, room(50), binary=True)
    names = sorted(path.name for path in (folder / "poses" / "images").iterdir())
    listed = {"names": names, "clips": [0] * 12, "seconds": [k / 6 for k in range(12)]}
    for k, name in enumerate(names):
        assert int(Path(name).stem) == k
    (folder / "poses" / "images" / "frames.json").write_text(json.dumps(listed))
    (folder / "rgb.mp4").write_bytes(b"x")
    return folder / "rgb.mp4"


def write_log(path: Path, places: np.ndarray) -> None:
    lines = [f"{k / 6}, {k:06d}, {x}, {z}, {-y}, 0, 0, 0, 1\n" for k, (x, y, z) in enumerate(places)]
    path.write_text(HEADER + "".join(lines))


def test_the_report_names_the_source_and_the_uncertainty(tmp_path: Path) -> None:
    source = filmed(tmp_path)
    footage = find_footage(source)
    assert footage is not None
    nothing = with_measured_scales(report_of(source), footage, tmp_path / "poses")
    assert nothing.measured == () and nothing.position_logs == ()
    write_log(tmp_path / "odometry.csv", 1.3 * walk(12)[:, :3, 3])
    found = with_measured_scales(nothing, footage, tmp_path / "poses")
    (measured,) = found.measured
    assert not measured.refused and measured.scale == pytest.approx(1.3, rel=1e-4)
    words = rows(found)["Measured scale"]
    assert words.startswith("the cameras are 1.3 m above the floor, from the ARKit log odometry.csv")
    assert "a standard deviation of 2.0 %; 12 of 12 positions agree" in words
    assert with_measured_scales(found, footage, tmp_path / "poses") is found  # the log is unchanged
    write_report(found, tmp_path)
    assert read_report(tmp_path) == found
    assert found.measured_options(tmp_path / "poses") == (None, measured.scale, None)
    assert found.measured_options(tmp_path / "poses", "1") == (None, None, None)
    assert not found.scale_contradiction(1.35, tmp_path)
    said = found.scale_contradiction(1.6, tmp_path)
    assert "1.6 m above the floor" in said and "gives 1.3 m (23 % apart)" in said
    level = replace(found, upright=(), measured=(replace(measured, up=(0.0, -1.0, 0.0)),))
    scale, height, alignment = level.measured_options(tmp_path)
    assert scale == measured.scale and height is None and alignment is not None
    assert alignment.rotation @ [0, -1, 0] == pytest.approx([0, 0, 1]) and alignment.scale_known


def test_a_damaged_log_is_named_in_the_report(tmp_path: Path) -> None:
    source = filmed(tmp_path)
    footage = find_footage(source)
    assert footage is not None
    write_log(tmp_path / "odometry.csv", np.full((12, 3), np.nan))
    found = with_measured_scales(report_of(source), footage, tmp_path / "poses")
    assert "odometry.csv, line 2" in found.measured[0].refused
    assert rows(found)["Measured scale"].startswith("none from a position log: ")
    assert found.measured_options(tmp_path) == (None, None, None)


def test_photographs_of_one_room_get_no_scale_from_gps(tmp_path: Path) -> None:
    filmed(tmp_path)
    photos = tmp_path / "photos"
    photos.mkdir()
    dice = np.random.default_rng(0)
    for name in sorted(path.stem for path in (tmp_path / "poses" / "images").glob("*.png")):
        photograph(photos / f"{name}.jpg", 48 + dice.normal(0, 4e-5), 11 + dice.normal(0, 4e-5), 12.0)
    footage = find_footage(photos)
    assert footage is not None and footage.kind == "photographs"
    found = with_measured_scales(report_of(photos), footage, tmp_path / "poses")
    assert "less than 7 times the error of a position" in found.measured[0].refused
    assert found.measured[0].source == "GPS of 12 photographs"


@pytest.mark.parametrize(
    ("field", "value"),
    [("scale", 0), ("scale", "far"), ("up", [1, 2, 3]), ("up", ["x", 0, 0]), ("positions", -1), ("source", 5)],
)
def test_a_report_with_a_damaged_scale_is_refused(tmp_path: Path, field: str, value: object) -> None:
    from nvsim.errors import InputError

    report = report_of(tmp_path, measured=(MeasuredScale("GPS", "", 1.0),))
    write_report(report, tmp_path)
    tree = json.loads((tmp_path / "poses.json").read_text())
    tree["measured"][0][field] = value
    (tmp_path / "poses.json").write_text(json.dumps(tree))
    with pytest.raises(InputError, match="poses.json"):
        read_report(tmp_path)
