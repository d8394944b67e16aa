"""Goals without language: boxes match the true objects, places are free and near, and readers find their keys."""

from __future__ import annotations

import gzip
import json
import math
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from boxed_scan import Block, export_blocks, flat_house

from nvsim.cli.main import main
from nvsim.dataset.agent_files import AGENTS, DatasetParts
from nvsim.dataset.word_pieces import Vocabulary
from nvsim.events import ignore_event
from nvsim.graph.types import NavGraph
from nvsim.r2r.features.backbone import Projection
from nvsim.r2r.features.exported_scan import read_exported_scans
from nvsim.r2r.features.objects import write_object_features

EPISODE = {
    "episode_id",
    "scene_id",
    "start_position",
    "start_rotation",
    "info",
    "goals",
    "start_room",
    "shortest_paths",
}
GOAL = {"position", "radius", "object_id", "object_name", "object_name_id", "object_category", "room_id", "room_name"}
GOAL |= {"view_points"}
IMAGE = {"position", "rotation", "hfov", "image_dimensions", "frame_coverage", "object_coverage"}
FEW = ["--fewest-edges", "2", "--least-meters", "2", "--train", "8", "--val-seen", "2", "--val-unseen", "0"]
SOFA = Block((1.2, 4.0, 0), (3.2, 4.9, 0.82), (0, 0, 0))
CABINET = Block((4.3, 2.6, 0), (4.95, 4.1, 1.8), (0, 0, 0))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Block], NavGraph]:
    folder = tmp_path_factory.mktemp("goals")
    blocks, graph = flat_house()
    scans = export_blocks(folder / "scans", blocks, graph)
    command = ["export", "tasks", "--scans", str(scans), "--out", str(folder / "tasks"), *FEW, "--goals", "--json"]
    assert main(command) == 0
    return folder / "tasks/goals", blocks, graph


def opened(path: Path) -> Any:
    with gzip.open(path, "rt") as file:
        return json.load(file)


def in_nvsim(place: list[float]) -> np.ndarray[Any, np.dtype[np.float64]]:
    x, y, z = place
    return np.array([x, -z, y])


def true_box(block: Block, eye: tuple[float, float, float], view: int) -> list[float]:
    """The box (left, top, right, bottom) of the corners of a block in one of the 36 views, by trigonometry alone."""
    heading, up = math.radians(30 * (view % 12)), math.radians(30 * (view // 12 - 1))
    f = 240 / math.tan(math.radians(30))
    pixels = []
    for corner in product(*zip(block.lo, block.hi)):
        east, north, above = (c - e for c, e in zip(corner, eye))
        right = east * math.cos(heading) - north * math.sin(heading)
        along = east * math.sin(heading) + north * math.cos(heading)
        depth, rise = along * math.cos(up) + above * math.sin(up), above * math.cos(up) - along * math.sin(up)
        if depth > 0.05:
            pixels.append((320 + f * right / depth, 240 - f * rise / depth))
    x, y = np.array(pixels).T
    return [*np.clip([x.min(), x.max()], 0, 640), *np.clip([y.min(), y.max()], 0, 480)]


def test_boxes_are_those_of_the_true_objects(made: tuple[Path, list[Block], NavGraph]) -> None:
    folder, _, graph = made
    found = json.loads((folder / "reverie/BBoxes.json").read_text())
    overlaps = []
    names = set()
    for key, objects in found.items():
        scan, id = key.split("_")
        assert scan == "boxes"
        assert json.loads((folder / f"reverie/BBox/{key}.json").read_text()) == {id: objects}
        for one in objects.values():
            names.add(one["name"])
            block = SOFA if one["name"] == "blue sofa" else CABINET
            assert len(one["visible_pos"]) == len(one["bbox2d"]) > 0
            for view, (x, y, w, h) in zip(one["visible_pos"], one["bbox2d"]):
                left, right, top, bottom = true_box(block, graph.viewpoints[id].position, view)
                shared = max(0.0, min(x + w, right) - max(x, left)) * max(0.0, min(y + h, bottom) - max(y, top))
                overlaps.append(shared / (w * h + (right - left) * (bottom - top) - shared))
    assert names == {"blue sofa", "tall red piece of furniture"}
    assert len(overlaps) > 20 and np.median(overlaps) > 0.8 and min(overlaps) > 0.55


def test_places_at_an_object_are_free_and_look_at_it(made: tuple[Path, list[Block], NavGraph]) -> None:
    folder, blocks, _ = made
    data = opened(folder / "objectnav/train/train.json.gz")
    (goal,) = data["goals_by_category"]["boxes.glb_sofa"]
    assert set(goal) == GOAL and np.hypot(*(in_nvsim(goal["position"])[:2] - (2.2, 4.45))) < 0.2
    standing = [block for block in blocks if block.hi[2] > 0.05 and block.lo[2] < 1.7]
    assert goal["view_points"]
    for one in goal["view_points"]:
        place = in_nvsim(one["agent_state"]["position"])
        assert place[2] == pytest.approx(0, abs=0.02) and SOFA.meters_to(place[None, :2])[0] <= 1.05
        assert min(float(block.meters_to(place[None, :2])[0]) for block in standing) >= 0.25
        x, y, z, w = one["agent_state"]["rotation"]
        heading = -2 * math.atan2(y, w)
        east, north = (2.2, 4.45) - place[:2]
        assert x == z == 0 and math.cos(heading - math.atan2(east, north)) > 0.95


def test_episodes_have_the_keys_and_goals_that_habitat_reads(made: tuple[Path, list[Block], NavGraph]) -> None:
    folder, _, graph = made
    tasks = json.loads((folder.parent / "R2R_train.json").read_text())
    points = opened(folder / "pointnav/train/train.json.gz")["episodes"]
    assert len(points) == len(tasks)
    for one, task in zip(points, tasks):
        assert set(one) == EPISODE and one["scene_id"] == "nvsim/boxes/boxes.glb"
        goal = in_nvsim(one["goals"][0]["position"])
        assert goal == pytest.approx(np.array(graph.viewpoints[task["path"][-1]].position) - (0, 0, 1.5), abs=1e-3)
        assert one["info"]["geodesic_distance"] == pytest.approx(task["distance"], abs=0.01)
        assert one["info"]["euclidean_distance"] <= one["info"]["geodesic_distance"] + 1e-3
    objects = opened(folder / "objectnav/train/train.json.gz")
    assert objects["category_to_task_category_id"].keys() == objects["category_to_scene_annotation_category_id"].keys()
    assert objects["episodes"] and all(set(one) == EPISODE | {"object_category"} for one in objects["episodes"])
    for one in objects["episodes"]:
        key = f"{Path(one['scene_id']).name}_{one['object_category']}"  # ObjectGoalNavEpisode.goals_key
        goals = objects["goals_by_category"][key]
        assert one["goals"] == [] and one["info"]["closest_goal_object_id"] in {goal["object_id"] for goal in goals}
        assert one["object_category"] in objects["category_to_task_category_id"]
    images = opened(folder / "instance_imagenav/train/train.json.gz")
    assert images["episodes"]
    for one in images["episodes"]:
        assert set(one) == EPISODE | {"object_category", "goal_object_id", "goal_image_id"}
        goal = images["goals"][f"boxes_{one['goal_object_id']}"]  # InstanceImageGoalNavEpisode.goal_key
        assert set(goal) == GOAL | {"image_goals"} and goal["object_id"] == one["goal_object_id"]
        image = goal["image_goals"][one["goal_image_id"]]
        assert set(image) == IMAGE and image["position"][1] == 1.5 and 0.5 <= image["object_coverage"] <= 1


def test_a_remote_object_is_in_the_last_view_and_named_once(made: tuple[Path, list[Block], NavGraph]) -> None:
    folder = made[0] / "reverie"
    boxes = json.loads((folder / "BBoxes.json").read_text())
    items = json.loads((folder / "REVERIE_train.json").read_text())
    assert items
    for item in items:
        objects = boxes[f"{item['scan']}_{item['path'][-1]}"]
        name = objects[str(item["objId"])]["name"]
        assert [one["name"] for one in objects.values()].count(name) == 1
        assert item["id"] == f"{item['path_id']}_{item['objId']}" and len(item["instructions"]) == 3
        assert all(text.endswith(f" Find the {name}.") for text in item["instructions"])
        assert [text.removesuffix(f" Find the {name}.") for text in item["instructions"]] == item["instructions_l"]


def angles(place: tuple[float, ...], eye: tuple[float, ...]) -> tuple[float, float]:
    """Heading in [0, 2 pi) and elevation of a place, as MatterSim has them."""
    east, north, above = (p - e for p, e in zip(place, eye))
    return math.atan2(east, north) % (2 * math.pi), math.atan2(above, math.hypot(east, north))


def test_soons_outlines_contain_the_true_objects(made: tuple[Path, list[Block], NavGraph]) -> None:
    """The keys and angles that `SoonObjectNavBatch` of VLN-DUET reads for its evaluation."""
    folder, _, graph = made
    lines = (folder / "soon/SOON_train.jsonl").read_text().splitlines()
    same = json.loads((folder / "reverie/REVERIE_train.json").read_text())
    boxes = json.loads((folder / "reverie/BBoxes.json").read_text())
    assert len(lines) == len(same) > 0
    for item, remote in zip(map(json.loads, lines), same):
        assert item["path_id"] == str(remote["path_id"]) and "_" not in item["path_id"]
        assert (item["scan"], item["path"]) == (remote["scan"], remote["path"])
        assert [one["full"] for one in item["instructions"]] == remote["instructions"]
        object = str(remote["objId"])
        ends = {key.split("_")[1] for key, found in boxes.items() if object in found}
        assert {one["image_id"] for one in item["bboxes"]} == ends and item["path"][-1] in ends
        block = SOFA if "sofa" in remote["instructions"][0].rpartition("Find the")[2] else CABINET
        for one in item["bboxes"]:
            eye, target = graph.viewpoints[one["image_id"]].position, one["target"]
            assert set(target) == {"center", "left_top", "right_top", "left_bottom", "right_bottom"}
            (left, top), (right, _) = (target[n].values() for n in ("left_top", "right_top"))
            _, bottom = target["right_bottom"].values()
            heading, elevation = target["center"].values()
            assert left < heading < right and bottom < elevation < top and 0 <= heading < 2 * math.pi
            assert target["left_bottom"] == {"heading": left, "elevation": bottom}
            corners = [angles(corner, eye) for corner in product(*zip(block.lo, block.hi))]
            beside = [(h - heading + math.pi) % (2 * math.pi) - math.pi for h, _ in corners]
            assert (left - heading, right - heading) == pytest.approx((min(beside), max(beside)), abs=0.15)
            assert (bottom, top) == pytest.approx((min(e for _, e in corners), max(e for _, e in corners)), abs=0.15)


def test_duet_and_hamt_construct_the_instructions_of_remote_objects(
    made: tuple[Path, list[Block], NavGraph], tmp_path: Path
) -> None:
    """The files and fields of VLN-DUET's map_nav_src/reverie/data_utils.py and map_nav_src/soon/data_utils.py."""
    pieces = ["[CLS]", "[SEP]", "[UNK]", *"abcdefghijklmnopqrstuvwxyz0123456789.,'-:"]
    pieces += [f"##{letter}" for letter in "abcdefghijklmnopqrstuvwxyz0123456789"]
    vocabulary = Vocabulary({piece: n for n, piece in enumerate(pieces)})
    parts = DatasetParts(made[0].parent.parent, ("boxes",), vocabulary, goals=True)

    def spelled(codes: list[int]) -> str:
        assert (codes[0], codes[-1]) == (0, 1)
        return "".join(pieces[code].removeprefix("##") for code in codes[1:-1])

    for name in ("duet", "hamt"):
        agent = AGENTS[name]
        annotated = {pattern: writer for pattern, writer in agent.goals.items() if "/annotations/" in pattern}
        for pattern, writer in annotated.items():
            for split in ("train", "val_train_seen", "val_seen", "val_unseen") if "{split}" in pattern else ("",):
                path = tmp_path / name / pattern.format(split=split)
                path.parent.mkdir(parents=True, exist_ok=True)
                writer(parts, path, split)
        annotations = tmp_path / name / "REVERIE/annotations"
        visible: dict[str, list[str]] = {}
        for key, objects in json.loads((annotations / "BBoxes.json").read_text()).items():
            scan, viewpoint = key.split("_")
            for id, found in objects.items():
                if found["visible_pos"]:
                    visible.setdefault(f"{scan}_{id}", []).append(viewpoint)
        for split in ("train", "val_train_seen", "val_seen", "val_unseen"):
            items = json.loads((annotations / f"REVERIE_{split}_enc.json").read_text())
            assert bool(items) == (split != "val_unseen")
            for item in items:
                assert item["path"][-1] in visible[f"{item['scan']}_{item['objId']}"] and item["path_id"] >= 0
                assert len(item["instructions"]) == len(item["instr_encodings"]) == 3
                for text, codes in zip(item["instructions"], item["instr_encodings"]):
                    assert spelled(codes) == "".join(text.lower().split())
    for split in ("train", "val_train", "val_unseen_instrs", "val_unseen_house"):
        lines = (tmp_path / f"duet/SOON/annotations/bert_enc/{split}_enc.jsonl").read_text().splitlines()
        assert bool(lines) == (split != "val_unseen_house")
        for item in map(json.loads, lines):
            assert {"path_id", "scan", "path", "bboxes"} <= set(item)
            for one, codes in zip(item["instructions"], item["instr_encodings"], strict=True):
                assert spelled(codes["full"]) == "".join(one["full"].lower().split())


def test_agents_find_features_of_each_object_with_its_direction(
    made: tuple[Path, list[Block], NavGraph], tmp_path: Path
) -> None:
    """As `ObjectFeatureDB` of VLN-DUET and `load_obj_database` of VLN-HAMT read them."""
    folder, _, graph = made
    boxes = json.loads((folder / "reverie/BBoxes.json").read_text())
    scans = read_exported_scans(folder.parent.parent / "scans", ["boxes"])
    write_object_features(scans, boxes, Projection(8), 12, tmp_path, ignore_event)
    soon = [json.loads(line) for line in (folder / "soon/SOON_train.jsonl").read_text().splitlines()]
    with h5py.File(tmp_path / "objects.hdf5") as file, h5py.File(tmp_path / "objects_corners.hdf5") as corners:
        assert set(file) == {key for key, objects in boxes.items() if objects}
        assert set(corners) == {f"boxes_{id}" for id in graph.viewpoints}  # VLN-DUET stops at any of them
        for key in set(corners) - set(file):
            assert list(corners[key].attrs["obj_ids"]) == ["none"] and corners[key].shape == (1, 12)
            assert corners[key].attrs["directions"] == pytest.approx(np.zeros((1, 2)))
        for key in file:
            rows, attributes, viewpoint = file[key][...], file[key].attrs, key.split("_")[1]
            ids = list(attributes["obj_ids"])
            assert ids == list(boxes[key]) and rows.shape == (len(ids), 12) and (rows.std(axis=1) > 0).all()
            for n, found in enumerate(boxes[key].values()):
                (width, height), (x, y, *size) = attributes["sizes"][n], attributes["bboxes"][n]
                assert [width, height] == size
                assert width * height == max(w * h for _, _, w, h in found["bbox2d"])
                assert [x, y, *size] == dict(zip(found["visible_pos"], found["bbox2d"]))[attributes["viewindexs"][n]]
                assert list(corners[key].attrs["bboxes"][n]) == [x, y, x + width, y + height]
                block = SOFA if found["name"] == "blue sofa" else CABINET
                middle = tuple((low + high) / 2 for low, high in zip(block.lo, block.hi))
                heading, elevation = angles(middle, graph.viewpoints[viewpoint].position)
                turned, raised = attributes["directions"][n]
                assert abs((turned - heading + math.pi) % (2 * math.pi) - math.pi) < 0.5 and 0 <= turned < 2 * math.pi
                assert abs(raised - elevation) < 0.5
    for item in soon:
        for one in item["bboxes"]:
            label = one["pseudo_label"]
            assert list(boxes[f"{item['scan']}_{one['image_id']}"])[label["idx"]] == label["obj_id"]


def test_goals_need_strips_with_depth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from task_samples import exported, house

    scans = exported(tmp_path, house("one", 5))
    assert main(["export", "tasks", "--scans", str(scans), "--out", str(tmp_path / "t"), "--goals"]) == 2
    assert "no strips with depth" in capsys.readouterr().err and not (tmp_path / "t").exists()
