"""The weak places of a video are named with the cause that made them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.footage.extraction import ExtractedFrames
from nvsim.reconstruction.weak_places import APART, BLANK, BLURRED, OTHER_CLIP, TURN, UNCLEAR, find_weak_places

COUNT, FOCAL, WIDTH, HEIGHT = 30, 900.0, 1280, 720


def filmed(
    move: NDArray[np.float64] | None = None,
    turn: NDArray[np.float64] | None = None,
    points: int = 200,
    clips: NDArray[np.int64] | None = None,
    blurred: tuple[int, ...] = (),
    new_after: int = -1,
) -> ExtractedFrames:
    """COUNT frames of a cloud of points. The camera is at `move` (COUNT, 3) meters, turned by `turn` (COUNT,) degrees
    about the vertical. After the frame `new_after`, all points have other numbers."""
    move = np.zeros((COUNT, 3)) if move is None else move
    turn = np.zeros(COUNT) if turn is None else turn
    world = np.random.default_rng(1).uniform((-9, -1.5, -9), (9, 1.5, 9), (40 * points, 3))
    frame, point, places = [], [], []
    for k in range(COUNT):
        c, s = np.cos(np.radians(turn[k])), np.sin(np.radians(turn[k]))
        local = (world - move[k]) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]).T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = FOCAL * local[:, :2] / local[:, 2:] + (WIDTH / 2, HEIGHT / 2)
        seen = (local[:, 2] > 2) & (pixels >= 0).all(axis=1) & (pixels < (WIDTH, HEIGHT)).all(axis=1)
        shown = np.flatnonzero(seen)[:points]
        frame.append(np.full(len(shown), k))
        point.append(shown + (len(world) if 0 <= new_after < k else 0))
        places.append(pixels[shown])
    return ExtractedFrames(
        Path("frames"),
        tuple(f"0_{10 * k:06d}.jpg" for k in range(COUNT)),
        WIDTH,
        HEIGHT,
        np.zeros(COUNT, np.int64) if clips is None else clips,
        np.arange(COUNT) / 3,
        np.isin(np.arange(COUNT), blurred),
        10 * COUNT,
        np.concatenate(frame),
        np.concatenate(point),
        np.concatenate(places),
    )


def ahead(step: float = 0.05) -> NDArray[np.float64]:
    return np.arange(COUNT)[:, None] * np.array([step, 0.0, step])


def test_frames_that_hold_together_have_no_weak_place() -> None:
    frames = filmed(ahead())
    assert find_weak_places(frames, [frames.names], FOCAL) == ()


def test_a_cut_between_two_pieces_is_one_place_between_two_frames() -> None:
    frames = filmed(ahead())
    (place,) = find_weak_places(frames, [frames.names[12:], frames.names[:12]], FOCAL)
    assert (place.first, place.last) == (frames.names[11], frames.names[12])
    assert place.seconds == (3.67, 4.0) and (place.cause, place.advice) == UNCLEAR


def test_frames_without_a_pose_are_one_place_from_the_frame_before_to_the_frame_after() -> None:
    frames = filmed(ahead())
    kept = [*frames.names[:10], *frames.names[13:28]]
    inner, end = find_weak_places(frames, [kept, frames.names[10:12]], FOCAL)  # the second piece is too small
    assert (inner.first, inner.last) == (frames.names[9], frames.names[13])
    assert (end.first, end.last) == (frames.names[27], frames.names[29])


def test_each_cause_is_told_from_what_the_frames_show() -> None:
    cut = 15
    sharp_turn = np.clip((np.arange(COUNT) - 11) * 4.0, 0, 32)
    clips = (np.arange(COUNT) >= cut).astype(np.int64)
    causes = {
        BLURRED: filmed(ahead(), blurred=(14, 15)),
        BLANK: filmed(ahead(), points=40),
        APART: filmed(ahead(), new_after=cut - 1),
        TURN: filmed(turn=sharp_turn),
        OTHER_CLIP: filmed(ahead(), clips=clips),
        UNCLEAR: filmed(ahead(0.15), turn=sharp_turn),  # a turn in a curve is no turn on the spot
    }
    for cause, frames in causes.items():
        (place,) = find_weak_places(frames, [frames.names[cut:], frames.names[:cut]], FOCAL)
        assert (place.cause, place.advice) == cause
