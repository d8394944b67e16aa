"""Image files that are consecutive frames of a video are recognized, and used in their order."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import textured_room as room

from nvsim.events import Log
from nvsim.footage.sequences import choose_in_order, is_sequence
from nvsim.footage.sources import need_footage
from nvsim.reconstruction.image_sets import store_images
from nvsim.reconstruction.report import FRAMES, PosesReport, WeakPlace, rows


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("frames")
    for i, pose in enumerate(room.walk(160)[:60]):
        cv2.imwrite(str(folder / f"frame_{i:03d}.png"), room.render(pose)[..., ::-1])
    return sorted(folder.iterdir())


def test_neighbors_with_the_same_points_are_frames_of_a_video(frames: list[Path]) -> None:
    assert is_sequence(frames)
    assert not is_sequence(frames[:19])  # too few to tell
    assert not is_sequence([frames[i] for i in np.random.default_rng(0).permutation(len(frames))])
    assert not is_sequence(frames[::10] * 4)  # photographs some steps apart


def test_a_standing_camera_adds_no_frames(frames: list[Path], tmp_path: Path) -> None:
    names = [path.name for path in frames]
    moving = choose_in_order(frames[0].parent, names)
    standing = choose_in_order(frames[0].parent, [names[0]] * 20 + names)
    assert 0.2 * len(names) < len(moving.names) < len(names)
    assert list(moving.names) == sorted(moving.names) and moving.looked_at == len(names)
    assert len(standing.names) <= len(moving.names) + 3
    shown = [set(moving.point[moving.frame == k]) for k in range(len(moving.names))]
    assert all(len(a & b) > 40 for a, b in zip(shown, shown[1:]))


def test_frames_are_stored_in_their_order_and_others_as_photographs(frames: list[Path], tmp_path: Path) -> None:
    said: list[str] = []

    def store(folder: Path) -> tuple[bool, set[str], tuple[str, ...]]:
        out = folder / "out"
        stored = store_images(
            need_footage(folder), out, lambda *_: None, lambda e: said.append(e.text) if isinstance(e, Log) else None
        )
        return stored.images.ordered, {path.name for path in out.iterdir()}, stored.images.names

    ordered, files, names = store(frames[0].parent)
    assert ordered and files == set(names) and len(names) < len(frames)
    assert f"{len(names)} of them are used, in their order" in said[-1]
    for i, k in enumerate(np.random.default_rng(0).permutation(len(frames))):
        (tmp_path / f"IMG_{i}.png").write_bytes(frames[k].read_bytes())
    ordered, files, names = store(tmp_path)
    assert not ordered and len(files) == len(frames)


def test_weak_places_of_frames_have_names_and_no_times() -> None:
    place = WeakPlace("frame_3.png", "frame_5.png", (3.0, 5.0), "the frames are blurred", "move more slowly here")
    report = PosesReport(
        "/house", FRAMES, (), 11, 60, 30, 0, 29, (29,), (300.0,), (320, 240), 0.5, 0, (), 9.0, weak=(place,)
    )
    assert report.image_noun == "frames"
    assert rows(report)["Weak place 1"].startswith("frame_3.png to frame_5.png: the frames are blurred.")
