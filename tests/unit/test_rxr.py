"""Tasks are written as RxR's files: aligned words, pose traces as its viewer reads them, and VLN-CE's episodes."""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest
from boxed_scan import export_blocks, flat_house
from numpy.typing import NDArray

from nvsim.cli.main import main
from nvsim.dataset.rxr import guide_of, pose_trace_of
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.r2r.tasks.task import Task

KEYS = {"path_id", "split", "scan", "heading", "path", "instruction_id", "annotator_id", "language", "instruction"}
KEYS |= {"timed_instruction", "edit_distance"}
POSITIONS = np.array([[1.0, 2.0, 1.5], [1.0, 4.0, 1.5], [3.0, 4.0, 1.6]])
TASK = Task(7, "house", ("a", "b", "c"), 5.5, ("Turn right. Go on. Stop there.",))


def trace(places: tuple[int, ...] = (0, 0, 1, 1, 2, 2)) -> dict[str, NDArray[np.generic]]:
    return pose_trace_of(guide_of(TASK, 0, places), POSITIONS)


def test_a_camera_sees_the_next_viewpoint_in_the_middle_before_it_moves_there() -> None:
    """As RxR's viewer reads it: y is up, and points are multiplied from the right."""
    found = trace()
    panos = found["pano"].tolist()
    for here, there in (("a", 1), ("b", 2)):
        last = len(panos) - 1 - panos[::-1].index(here)
        pose = found["extrinsic_matrix"][last]
        projection = found["intrinsic_matrix"][last]
        x, y, z = POSITIONS[there]
        clip = projection @ np.linalg.inv(pose) @ np.array([x, z, -y, 1.0])
        assert clip[3] > 0 and abs(clip[0] / clip[3]) < 0.05 and abs(clip[1] / clip[3]) < 0.1
        assert pose[:3, 3] == pytest.approx(
            [POSITIONS[there - 1][0], POSITIONS[there - 1][2], -POSITIONS[there - 1][1]]
        )
    pose = found["extrinsic_matrix"][0]
    assert -pose[:3, 2] == pytest.approx([math.sin(5.5), 0, -math.cos(5.5)], abs=1e-6)


def test_words_times_and_panoramas_agree() -> None:
    guide, found = guide_of(TASK, 0, (0, 0, 1, 1, 2, 2)), trace()
    time, pano = found["time"], found["pano"]
    for place, start in zip(guide.places, guide.starts):
        assert pano[np.abs(time - (start + 0.2)).argmin()] == TASK.path[place]
    assert time[-1] >= guide.starts[-1] + 0.4 - 0.11 and (np.diff(time) > 0).all()
    assert found["text_masks"].tolist() == [[True] * 2 + [False] * 4, [False] * 2 + [True] * 2 + [False] * 2] + [
        [False] * 4 + [True] * 2
    ]
    assert set(trace((0, 0, 0, 0, 2, 2))["pano"]) == {"a", "b", "c"}  # no words, but one snapshot


def test_masks_are_the_union_of_all_snapshots() -> None:
    found = trace()
    rows, columns = np.mgrid[:128, :256]
    heading, up = ((columns + 0.5) / 256 - 0.5) * 2 * math.pi, (0.5 - (rows + 0.5) / 128) * math.pi
    ways = np.stack([np.sin(heading) * np.cos(up), np.sin(up), -np.cos(heading) * np.cos(up)], axis=-1)
    for i, name in enumerate(TASK.path):
        slow = np.zeros((128, 256), bool)
        for pose, projection in zip(
            found["extrinsic_matrix"][found["pano"] == name], found["intrinsic_matrix"], strict=False
        ):
            local = ways @ pose[:3, :3]
            p = projection
            w = -local[..., 2]
            inside = (np.abs(p[0, 0] * local[..., 0]) <= w) & (np.abs(p[1, 1] * local[..., 1]) <= w)
            slow |= inside & (w > 0)
        assert (slow != found["image_mask"][i]).mean() < 0.01 and slow.mean() > 0.06
        assert not (slow & ~found["image_mask"][i]).any()


def test_weights_are_means_of_the_mask_in_each_of_the_36_views() -> None:
    found = trace()
    mask, weights = found["image_mask"][1], found["feature_weights"][1]
    for view in range(36):
        heading, up = math.radians(30 * (view % 12)), math.radians(30 * (view // 12 - 1))
        camera = Camera(Intrinsics.from_fov(160, 120, 2 * math.atan(math.tan(math.radians(30)) * 4 / 3)), camera_pose(
            np.zeros(3), heading, up
        ))  # fmt: skip
        x, y, z = np.moveaxis(camera.rays().astype(float), -1, 0)
        columns = ((np.arctan2(x, y) / (2 * math.pi) + 0.5) * 256).astype(int) % 256
        rows = ((0.5 - np.arctan2(z, np.hypot(x, y)) / math.pi) * 128).astype(int).clip(0, 127)
        assert weights[view] == pytest.approx(mask[rows, columns].mean(), abs=0.03)
    assert weights.max() > 0.9 and weights.min() == 0


def test_files_have_the_keys_of_rxr_and_of_vlnce(tmp_path: Path) -> None:
    _, graph = flat_house()
    scans, out = export_blocks(tmp_path / "scans", flat_house()[0], graph), tmp_path / "tasks"
    few = ["--fewest-edges", "2", "--least-meters", "3", "--train", "5", "--val-seen", "2", "--val-unseen", "0"]
    command = ["export", "tasks", "--scans", str(scans), "--out", str(out), *few, "--register", "rxr", "--json"]
    assert main([*command, "--rxr", "--vlnce"]) == 0
    tasks = {task["path_id"]: task for task in json.loads((out / "R2R_train.json").read_text())}
    with gzip.open(out / "rxr/rxr_train_guide.jsonl.gz", "rt") as file:
        guides = [json.loads(line) for line in file]
    assert len(guides) == 15 and len({guide["instruction_id"] for guide in guides}) == 15
    legs = 0
    for guide in guides:
        task = tasks[guide["path_id"]]
        assert set(guide) == KEYS and guide["language"] == "en-US" and guide["split"] == "train"
        assert guide["instruction"] in task["instructions"] and guide["path"] == task["path"]
        words = guide["timed_instruction"]
        assert " ".join(word["word"] for word in words) == guide["instruction"]
        assert words[0]["start_time"] > 0 and all(
            a["start_time"] < a["end_time"] <= b["start_time"] for a, b in zip(words, words[1:])
        )
        with np.load(out / f"rxr/pose_traces/rxr_train/{guide['instruction_id']:06}_guide_pose_trace.npz") as found:
            k, n = len(guide["path"]), len(found["time"])
            assert found["pano"].shape == (n,) and found["extrinsic_matrix"].shape == (n, 4, 4)
            assert found["image_mask"].shape == (k, 128, 256) and found["feature_weights"].shape == (k, 36)
            assert list(dict.fromkeys(found["pano"].tolist())) == guide["path"]
            assert found["text_masks"].shape == (k, len(words)) and (found["text_masks"].sum(axis=0) == 1).all()
            last = [w["word"] for w, mask in zip(words, found["text_masks"][-1]) if mask]
            assert last[-1].endswith(".") and len(last) < len(words)
            legs += found["text_masks"][1:-1].any()
    assert legs
    with gzip.open(out / "rxr/RxR_VLNCE_v0/train/train_guide.json.gz", "rt") as file:
        episodes = json.load(file)["episodes"]
    with gzip.open(out / "rxr/RxR_VLNCE_v0/train/train_guide_gt.json.gz", "rt") as file:
        truth = json.load(file)
    assert episodes and {one["episode_id"] for one in episodes} == set(truth)
    for one in episodes:
        guide = next(g for g in guides if str(g["instruction_id"]) == one["episode_id"])
        assert one["instruction"]["timed_instruction"] == guide["timed_instruction"]
        gt, heading = truth[one["episode_id"]], tasks[guide["path_id"]]["heading"]
        place = np.array(one["start_position"], float)
        for action, where in zip(gt["actions"], gt["locations"]):
            assert place[[0, 2]] == pytest.approx(np.array(where)[[0, 2]], abs=2e-3)
            heading += math.radians({2: -30, 3: 30}.get(action, 0))
            place += 0.25 * (action == 1) * np.array([math.sin(heading), 0, -math.cos(heading)])
        assert math.dist(place, one["goals"][0]["position"]) <= 0.31
    assert main([*command, "--rxr", "--instructions", "0"]) == 2
    assert main([*command, "--rxr", "--instructions", "1"]) == 0  # pose traces of other instructions are removed
    assert len(list((out / "rxr/pose_traces/rxr_train").iterdir())) == 5
    assert main([*command]) == 0  # without --rxr, the files of the earlier run are removed
    assert not (out / "rxr/rxr_train_guide.jsonl.gz").exists()
