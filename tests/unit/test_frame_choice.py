"""Frames of a video are chosen by how far the camera moved, sharp ones first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from textured_video import HEIGHT, WIDTH, blurred, shifted, texture, view, write_video

from nvsim.errors import InputError
from nvsim.footage.extraction import extract_frames
from nvsim.footage.frame_choice import ChosenFrame, choose_frames, point_positions
from nvsim.footage.sources import Footage
from nvsim.footage.tracking import TrackedFrame

PLANE = texture()
STILL, MOVING, PACE = 12, 20, 9.0


def images_at(places: list[float]) -> list[NDArray[np.uint8]]:
    return [view(PLANE, shifted(x, 100)) for x in places]


def moving(count: int = MOVING, begin: float = 100.0) -> list[float]:
    return [begin + PACE * k for k in range(count)]


def numbers(chosen: list[ChosenFrame]) -> list[int]:
    return [c.frame.number for c in chosen]


@pytest.fixture(scope="module")
def halting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Still, then moving, then still."""
    there = moving()
    places = [there[0]] * STILL + there + [there[-1]] * STILL
    return write_video(tmp_path_factory.mktemp("videos") / "halting.avi", images_at(places))


def test_still_periods_yield_no_frames_and_moving_ones_do(halting: Path) -> None:
    chosen = numbers(list(choose_frames((halting,))))
    assert chosen[0] == 0
    assert not [n for n in chosen if 0 < n < STILL]
    assert len([n for n in chosen if n >= STILL + MOVING]) <= 1  # the last frame
    between = [n for n in chosen if STILL <= n < STILL + MOVING]
    assert len(between) >= 3
    steps = np.diff(between) * PACE / WIDTH
    assert (steps > 0.03).all() and (steps < 0.3).all()


def test_a_video_that_does_not_move_has_one_frame(tmp_path: Path) -> None:
    path = write_video(tmp_path / "still.avi", images_at([100.0] * 15))
    assert numbers(list(choose_frames((path,)))) == [0]


def test_points_of_chosen_frames_moved_as_the_camera_did(halting: Path) -> None:
    chosen = list(choose_frames((halting,)))
    for before, after in zip(chosen[1:], chosen[2:], strict=False):
        mine, theirs = before.tracked.shared_with(after.tracked)
        moved = before.tracked.places[mine] - after.tracked.places[theirs]
        expected = PACE * (min(after.frame.number, STILL + MOVING - 1) - before.frame.number)
        assert len(mine) > 30
        assert np.abs(np.median(moved, axis=0) - (expected, 0)).max() < 0.3


def test_a_blurred_frame_is_not_chosen_while_a_sharp_one_is_near(tmp_path: Path) -> None:
    images = images_at(moving(24))
    plain = numbers(list(choose_frames((write_video(tmp_path / "sharp.avi", images),))))
    spoiled = plain[2]
    images[spoiled] = blurred(images[spoiled], 21)
    chosen = list(choose_frames((write_video(tmp_path / "spoiled.avi", images),)))
    assert spoiled not in numbers(chosen)
    assert not any(c.blurred for c in chosen)
    # The thread is not lost at the blurred frame.
    for before, after in zip(chosen, chosen[1:], strict=False):
        assert len(before.tracked.shared_with(after.tracked)[0]) > 30


def test_a_long_blurred_period_is_bridged_by_a_frame_marked_as_blurred(tmp_path: Path) -> None:
    images = images_at(moving(36))
    for k in range(10, 34):
        images[k] = blurred(images[k], 15)
    chosen = list(choose_frames((write_video(tmp_path / "smeared.avi", images),)))
    marked = [c.frame.number for c in chosen if c.blurred]
    assert marked and all(10 <= n < 34 for n in marked)
    assert np.diff(numbers(chosen)).max() < 10


def test_ids_are_unique_and_increasing_over_two_clips(tmp_path: Path) -> None:
    paths = tuple(write_video(tmp_path / f"{k}.avi", images_at(moving(12, 100 + 60 * k))) for k in range(2))
    seen: list[tuple[int, int]] = []
    chosen = list(choose_frames(paths, lambda done, total: seen.append((done, total))))
    assert [c.clip for c in chosen] == sorted(c.clip for c in chosen) and {c.clip for c in chosen} == {0, 1}
    for c in chosen:
        assert (np.diff(c.tracked.ids) > 0).all()
    first, second = (np.concatenate([c.tracked.ids for c in chosen if c.clip == k]) for k in range(2))
    assert first.max() < second.min()
    assert [done for done, _ in seen] == list(range(1, 25)) and {total for _, total in seen} == {24}


def test_a_cut_to_another_scene_loses_all_points_and_both_scenes_are_shown(tmp_path: Path) -> None:
    other = [view(texture(seed=9), shifted(x, 100)) for x in moving(12)]
    path = write_video(tmp_path / "cut.avi", images_at(moving(12)) + other)
    chosen = list(choose_frames((path,)))
    assert [n for n in numbers(chosen) if n < 12] and [n for n in numbers(chosen) if n >= 12]
    assert numbers(chosen) == sorted(set(numbers(chosen)))


def test_pixels_of_the_stored_image_have_their_first_center_at_a_half() -> None:
    places = np.array([[0, 0], [10, 20]], np.float32)
    frame = TrackedFrame(np.zeros((HEIGHT, WIDTH), np.uint8), np.arange(2), places, np.zeros(2, np.float32), np.eye(3))
    assert point_positions(frame, 2.0).tolist() == [[1, 1], [21, 41]]


def test_extracted_frames_are_read_again_and_are_written_anew_for_another_video(tmp_path: Path, halting: Path) -> None:
    folder, calls = tmp_path / "frames", []
    footage = Footage(halting, "video", (halting,))
    found = extract_frames(footage, folder, lambda done, total: calls.append(done))
    assert (found.width, found.height) == (WIDTH, HEIGHT) and found.looked_at == 2 * STILL + MOVING
    assert len(found.names) == len(found.clips) == len(found.seconds) == len(found.blurred)
    assert sorted(f.name for f in folder.glob("*.jpg")) == sorted(found.names)
    assert set(found.frame.tolist()) == set(range(len(found.names)))
    count = len(calls)
    again = extract_frames(footage, folder, lambda done, total: calls.append(done))
    assert len(calls) == count
    assert again.names == found.names and np.array_equal(again.places, found.places)
    other = write_video(tmp_path / "other.avi", images_at(moving(12)))
    assert extract_frames(Footage(other, "video", (other,)), folder).looked_at == 12


def test_videos_of_two_sizes_are_refused(tmp_path: Path, halting: Path) -> None:
    small = write_video(tmp_path / "small.avi", [i[:120, :160] for i in images_at(moving(6))])
    with pytest.raises(InputError, match="160x120 pixels and another video 320x240"):
        extract_frames(Footage(tmp_path, "video", (halting, small)), tmp_path / "frames")
    assert not (tmp_path / "frames").exists()
