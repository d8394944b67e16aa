"""The folder of every agent, opened as the loader of the agent does: its names, keys, and shapes."""

from __future__ import annotations

import base64
import csv
import gzip
import json
import math
import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2
import h5py
import networkx as nx
import numpy as np
import pytest
from scan_samples import scan_project
from test_dataset import FEW, row

from nvsim.cli.main import main
from nvsim.dataset.agent_files import AGENTS, AgentName, DatasetParts, write_agent
from nvsim.dataset.agent_readme import readme
from nvsim.dataset.building import _scenes
from nvsim.dataset.frames import DrawnEpisode, write_frames
from nvsim.dataset.lerobot import rows_of
from nvsim.dataset.parquet import parquet_bytes
from nvsim.dataset.text_views import read_text_views
from nvsim.dataset.word_pieces import Vocabulary
from nvsim.errors import InputError
from nvsim.events import ignore_event
from nvsim.mapping.config import MappingConfig
from nvsim.project.project import Project
from nvsim.project.scene_views import LiveScene
from nvsim.r2r.episodes.episode import Episode, write_streamvln, write_vlnce
from nvsim.r2r.episodes.episode_actions import ActionPath
from nvsim.r2r.features.exported_scan import ExportedScan
from nvsim.r2r.observations.export import PreparedExport
from nvsim.r2r.simulator import Simulator
from nvsim.r2r.simulator.images import ViewSize
from nvsim.r2r.simulator.live import LiveImages
from nvsim.r2r.tasks.task import Task, write_tasks

PIECES = ("[PAD]", "[UNK]", "[CLS]", "[SEP]", *"abcdefghijklmnopqrstuvwxyz0123456789.,!?-':")
PIECES += tuple(f"##{char}" for char in "abcdefghijklmnopqrstuvwxyz0123456789") + (
    "turn",
    "left",
    "door",
    "##way",
    "##s",
)
SPLITS = ("train", "val_train_seen", "val_seen", "val_unseen")
STUB = ("ZMojNkEp431", "2f4d90acd4024c269fb0efe49a8ac540")
ON_GRAPHS = [name for name in AGENTS if not AGENTS[name].scenes]
IN_ITS_FOLDER: tuple[AgentName, ...] = ("recurrent-vln-bert", "envdrop")
"""Agents that open files relative to the current folder."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("lmdb", reason="the extra `navgpt2` is not installed")
    folder = tmp_path_factory.mktemp("dataset")
    root = scan_project(folder)
    with Project.open(root, writable=True) as opened:
        opened.set_graph(row())
    (folder / "vocab.txt").write_text("\n".join(PIECES) + "\n")
    out = folder / "out"
    command = ["export", "dataset", "--project", str(root), "--out", str(out), "--size", "64", "--projection", *FEW]
    assert main([*command, "--goals", "--for", *ON_GRAPHS, "--vocabulary", str(folder / "vocab.txt")]) == 0
    return out


def load(path: Path) -> object:
    return json.loads(path.read_text())


def as_nav_graphs(connectivity: Path) -> dict[str, nx.Graph]:
    """As the agents' `load_nav_graphs` does for all scans of scans.txt."""
    graphs = {}
    for scan in (connectivity / "scans.txt").read_text().split():
        data = json.loads((connectivity / f"{scan}_connectivity.json").read_text())
        graphs[scan] = nx.Graph()
        for item in data:
            for j, free in enumerate(item["unobstructed"]):
                if free and item["included"] and data[j]["included"]:
                    assert data[j]["unobstructed"][data.index(item)], "Graph should be undirected"
                    graphs[scan].add_edge(item["image_id"], data[j]["image_id"])
    return graphs


def check_paths(items: list[dict], graphs: dict[str, nx.Graph]) -> None:
    for item in items:
        assert isinstance(item["path_id"], int) and 0 <= item["heading"] < 2 * np.pi
        assert nx.is_path(graphs[item["scan"]], item["path"])


@pytest.mark.parametrize("name", ON_GRAPHS)
def test_every_agent_has_the_graph_with_the_stub_and_a_readme(dataset: Path, name: AgentName) -> None:
    folder = dataset / "agents" / name
    connectivity = folder / ("connectivity" if name in IN_ITS_FOLDER else "R2R/connectivity")
    assert (connectivity / "scans.txt").read_text().split() == ["hall", STUB[0]]
    stub = load(connectivity / f"{STUB[0]}_connectivity.json")
    assert [(item["image_id"], item["included"]) for item in stub] == [(STUB[1], True)]
    assert as_nav_graphs(connectivity)["hall"].number_of_edges() == 5
    readme = (folder / "README.md").read_text()
    assert AGENTS[name].title in readme and f"FOLDER={folder}\n" in readme and "{" not in readme


@pytest.mark.parametrize("name", ON_GRAPHS)
def test_the_simulator_turns_in_the_stub_and_walks_in_the_scan(dataset: Path, name: AgentName) -> None:
    """As `get_point_angle_feature` of DUET and Recurrent-VLN-BERT: 36 views at the viewpoint that they name."""
    folder = dataset / "agents" / name
    sim = Simulator()
    sim.setNavGraphPath(str(folder / ("connectivity" if name in IN_ITS_FOLDER else "R2R/connectivity")))
    sim.setRenderingEnabled(False)
    sim.setDiscretizedViewingAngles(True)
    sim.initialize()
    sim.newEpisode([STUB[0]], [STUB[1]], [0.0], [math.radians(-30)])
    for view in range(36):
        if view:
            sim.makeAction([0], [1.0], [1.0 if view % 12 == 0 else 0.0])
        assert sim.getState()[0].viewIndex == view
    sim.newEpisode(["hall"], [f"{2:032x}"], [0.0], [0.0])
    assert sim.getState()[0].location.viewpointId == f"{2:032x}"


@pytest.mark.parametrize("name", ["duet", "hamt"])
def test_duet_and_hamt_construct_their_instructions_and_find_their_features(dataset: Path, name: AgentName) -> None:
    folder = dataset / "agents" / name / "R2R"
    graphs = as_nav_graphs(folder / "connectivity")
    count = 0
    for split in SPLITS:
        items = load(folder / "annotations" / f"R2R_{split}_enc.json")
        check_paths(items, graphs)
        for item in items:
            assert len(item["instructions"]) == len(item["instr_encodings"]) == 3
            for text, codes in zip(item["instructions"], item["instr_encodings"]):
                assert codes[0] == 2 and codes[-1] == 3 and 1 not in codes
                joined = "".join(PIECES[code].removeprefix("##") for code in codes[1:-1])
                assert joined == "".join(text.lower().split())
                count += 1
    assert count == 3 * (4 + 4 + 1)
    with h5py.File(folder / "features" / "pth_vit_base_patch16_224_imagenet.hdf5") as file:
        for viewpoint in graphs["hall"]:
            feature = file[f"hall_{viewpoint}"][...][:, :768].astype(np.float32)
            assert feature.shape == (36, 768) and feature.std() > 0


def test_duet_and_hamt_open_their_files_for_remote_objects(dataset: Path) -> None:
    reverie = "obj.avg.top3.min80_vit_base_patch16_224_imagenet.hdf5"
    fine_tuned = "obj_pth_vit_base_patch16_224_imagenet_r2r.e2e.ft.22k.hdf5"
    for name, file in (("duet", reverie), ("hamt", fine_tuned)):
        folder = dataset / "agents" / name
        assert "REVERIE/annotations/REVERIE_SPLIT_enc.json`" in (folder / "README.md").read_text()
        boxes = load(folder / "REVERIE/annotations/BBoxes.json")
        with h5py.File(folder / "REVERIE/features" / file) as features:
            assert set(features) == {key for key, found in boxes.items() if found}
        for split in SPLITS:
            for item in load(folder / "REVERIE/annotations" / f"REVERIE_{split}_enc.json"):
                assert len(item["instructions"]) == len(item["instr_encodings"])
    soon = dataset / "agents/duet/SOON"
    with h5py.File(soon / "features/filtered_butd_bboxes.hdf5") as features:
        assert len(features) == 6 and all(len(features[key].attrs["obj_ids"]) == len(features[key]) for key in features)
    for split in ("train", "val_train", "val_unseen_instrs", "val_unseen_house"):
        assert (soon / "annotations/bert_enc" / f"{split}_enc.jsonl").is_file()


def test_duets_pre_training_finds_its_trajectories_and_candidates(dataset: Path) -> None:
    annotations = dataset / "agents" / "duet" / "R2R" / "annotations"
    candidates = load(annotations / "scanvp_candview_relangles.json")
    lines = (annotations / "pretrain_map" / "R2R_train_enc.jsonl").read_text().splitlines()
    assert len(lines) == 12
    for item in map(json.loads, lines):
        assert item["instr_id"].split("_")[1] in "012" and item["pos_vps"] == [item["path"][-1]]
        assert item["instr_encoding"][0] == 2 and isinstance(item["heading"], float)
        for here, there in zip(item["path"], item["path"][1:]):
            view, *_ = candidates[f"{item['scan']}_{here}"][there]
            assert 0 <= view < 36


@pytest.mark.parametrize(
    ("name", "tasks", "table"),
    [
        ("recurrent-vln-bert", "data", "ResNet-152-places365.tsv"),
        ("envdrop", "tasks/R2R/data", "ResNet-152-imagenet.tsv"),
    ],
)
def test_agents_with_tables_read_their_features_and_paths(
    dataset: Path, name: AgentName, tasks: str, table: str
) -> None:
    folder = dataset / "agents" / name
    graphs = as_nav_graphs(folder / "connectivity")
    fields = ["scanId", "viewpointId", "image_w", "image_h", "vfov", "features"]
    features = {}
    csv.field_size_limit(1 << 30)
    with open(folder / "img_features" / table) as file:
        for item in csv.DictReader(file, delimiter="\t", fieldnames=fields):
            key = f"{item['scanId']}_{item['viewpointId']}"
            assert (int(item["image_w"]), int(item["image_h"]), int(item["vfov"])) == (640, 480, 60)
            features[key] = np.frombuffer(base64.decodebytes(item["features"].encode("ascii")), np.float32)
    scans = {key.split("_")[0] for key in features}
    for split in SPLITS:
        items = load(folder / tasks / f"R2R_{split}.json")
        check_paths(items, graphs)
        for item in items:
            assert item["scan"] in scans and item["distance"] > 0 and len(item["instructions"]) == 3
            assert all(features[f"{item['scan']}_{id}"].reshape(36, 2048).std() > 0 for id in item["path"])


def test_recurrent_vln_bert_finds_the_path_of_every_id(dataset: Path) -> None:
    data = dataset / "agents" / "recurrent-vln-bert" / "data"
    items = [item for split in SPLITS for item in load(data / f"R2R_{split}.json")]
    assert load(data / "id_paths.json") == {str(item["path_id"]): [item["scan"], item["path"]] for item in items}


@pytest.mark.parametrize(("name", "splits"), [("train", ("train",)), ("trainval", ("train", "val_seen", "val_unseen"))])
def test_envdrops_vocabulary_has_the_words_of_its_splits(dataset: Path, name: str, splits: tuple[str, ...]) -> None:
    data = dataset / "agents" / "envdrop" / "tasks" / "R2R" / "data"
    words = (data / f"{name}_vocab.txt").read_text().splitlines()
    texts = [text for split in splits for item in load(data / f"R2R_{split}.json") for text in item["instructions"]]
    # As EnvDrop's tokenizer: letters and digits, or single punctuation marks.
    used = Counter(token for text in texts for token in re.findall(r"\w+|[^\w\s]", text.lower()))
    assert words[:3] == ["<PAD>", "<UNK>", "<EOS>"]
    assert sorted(words[3:]) == sorted(word for word, count in used.items() if count >= 5)
    assert [used[word] for word in words[3:]] == sorted((used[word] for word in words[3:]), reverse=True)


def test_mapgpt_finds_every_instruction_and_every_view(dataset: Path) -> None:
    folder = dataset / "agents" / "mapgpt"
    graphs = as_nav_graphs(folder / "R2R" / "connectivity")
    items = load(folder / "R2R" / "annotations" / "train_processed.json")
    check_paths(items, graphs)
    assert {item["instr_id"] for item in items} == {f"{i['path_id']}_{k}" for i in items for k in range(3)}
    assert all(isinstance(item["instruction"], str) and item["instruction"] for item in items)
    for viewpoint in graphs["hall"]:
        for view in range(36):
            assert (folder / "images" / "hall" / viewpoint / f"{view}.jpg").read_bytes()[:2] == b"\xff\xd8"
    linked = folder / "images" / "hall" / next(iter(graphs["hall"])) / "0.jpg"
    assert linked.samefile(dataset / "scans" / "views" / "hall" / linked.parent.name / "0.jpg")


def test_navgpt_finds_texts_of_eight_directions_for_every_viewpoint(dataset: Path) -> None:
    folder = dataset / "agents" / "navgpt" / "R2R"
    graph = as_nav_graphs(folder / "connectivity")["hall"]
    navigable = load(folder / "navigable" / "hall_navigable.json")
    details = load(folder / "observations_list_summarized" / "hall.json")
    summaries = load(folder / "observations_summarized" / "hall_summarized.json")
    objects = load(folder / "objects_list" / "hall.json")
    assert set(navigable) == set(details) == set(summaries) == set(objects) == set(graph)
    for id in graph:
        assert set(navigable[id]) == set(graph[id])
        assert all({"heading", "elevation", "distance"} <= set(to) for to in navigable[id].values())
        assert len(details[id]) == len(objects[id]) == 8 and all(isinstance(text, str) for text in details[id])
        assert isinstance(summaries[id], str) and summaries[id]
        for found in objects[id]:
            assert all(0 <= at["heading"] < 360 and at["distance"] > 0 for at in found.values())
    for item in load(folder / "annotations" / "R2R_train_instr.json"):
        assert item["instr_id"].startswith(f"{item['path_id']}_") and item["instruction"] and item["path"]


def test_texts_name_what_is_near_in_its_direction(tmp_path: Path) -> None:
    thing = {"colour": "red", "shape": "sofa"}
    seen = {
        "things": [{"colour": "green", "shape": "object"}, thing],
        "kinds": {"a": "corridor"},
        "near": {"a": [{"thing": 1, "heading": -0.3, "metres": 1.6}, {"thing": 0, "heading": -0.5, "metres": 0.72}]},
        "doorways": [{"from": "a", "to": "b", "metres": [0.9]}, {"from": "b", "to": "a", "metres": [1.1]}],
    }
    (tmp_path / "surroundings.json").write_text(json.dumps({"house": seen}))
    places = np.array([[0.0, 0.0, 1.5], [2.0, 0.0, 1.5]])
    scan = ExportedScan("house", tmp_path, ("a", "b"), places, np.zeros((2, 3, 3)), np.zeros((0, 2), np.int64))
    views = read_text_views(tmp_path / "surroundings.json", scan)
    nothing = "No object with a name is near."
    # Front is +y; the sofa is 17 degrees to the left of it, the object 29 degrees, and the doorway is on the right.
    east, front, north_west = (
        "A doorway, 0.9 meters away.",
        "A red sofa, 1.6 meters away.",
        "A green object, 0.7 meters away.",
    )
    assert views["a"].sentences == [front, nothing, east, *[nothing] * 4, north_west]
    assert views["a"].summary == "A corridor. Near it: a red sofa, a doorway, a green object."
    assert views["b"].sentences[6] == "A doorway, 1.1 meters away." and views["b"].summary.startswith(
        "An indoor place."
    )
    assert views["a"].found[0]["red sofa"]["heading"] == pytest.approx(360 - np.degrees(0.3))
    (tmp_path / "surroundings.json").write_text(json.dumps({"house": {"near": {"a": [{"thing": 9}]}}}))
    with pytest.raises(InputError, match="is damaged"):
        read_text_views(tmp_path / "surroundings.json", scan)


def test_navgpt2_finds_the_row_of_every_candidate(dataset: Path) -> None:
    import lmdb
    import msgpack

    folder = dataset / "agents" / "navgpt2" / "R2R"
    candidates = load(folder / "annotations" / "scanvp_candidates.json")
    path = str(folder / "features" / "MP3D_eva_clip_g_can.lmdb")
    with lmdb.open(path, readonly=True, lock=False) as environment, environment.begin() as transaction:
        for key, rows in candidates.items():
            found = msgpack.unpackb(transaction.get(key.encode("ascii")))
            array = np.frombuffer(found[b"data"], dtype=found[b"type"]).reshape(found[b"shape"])
            assert array.shape == (len(rows), 257, 1408)
            assert sorted(number for _, number, *_ in rows.values()) == list(range(len(rows)))


HABITAT = {
    "streamvln": ("data/datasets/r2r", "data/scene_datasets"),
    "vlnce": ("data/datasets/R2R_VLNCE_v1-3_preprocessed", "data/scene_datasets"),
    "navid": ("data/datasets/R2R_VLNCE_v1-3_preprocessed", "data/scene_datasets"),
    "internnav": ("data/vln_ce/raw_data/r2r", "data/scene_data/mp3d_ce"),
}
"""Folders of the episodes and of the scenes."""


def test_agents_that_move_in_small_steps_find_their_frames_episodes_and_scenes(tmp_path: Path) -> None:
    root = scan_project(tmp_path)
    with Project.open(root) as project:
        source = PreparedExport.of(project, tmp_path / "scans").source
        # Two turns to the left and two steps ahead, from 1.6 m on along x.
        headings = np.radians([90.0, 75.0, 60.0, 60.0, 60.0])
        places = np.array(
            [[3.6, 3.0]] * 3 + [[3.6 + k * 0.25 * math.sin(headings[-1]), 3.0 + k * 0.125] for k in (1, 2)]
        )
        walk = ActionPath((2, 2, 1, 1, 0), places, headings)
        task = Task(7, "hall", ("a", "b"), float(headings[0]), ("Go.", "Walk."))
        episode = Episode(task, np.zeros((2, 3)), walk, np.full(5, 0.1))
        episodes = {"train": [episode], "val_seen": [], "val_unseen": []}
        write_frames({"hall": source}, episodes, tmp_path / "frames", ignore_event, look_down=True)
        write_streamvln(episodes, tmp_path / "tasks" / "streamvln")
        write_vlnce(episodes, tmp_path / "tasks" / "vlnce")
        for split in episodes:
            write_tasks(tmp_path / "tasks" / f"R2R_{split}.json", [one.task for one in episodes[split]])
        scene = tmp_path / "scenes" / "nvsim" / "hall" / "hall.glb"
        scene.parent.mkdir(parents=True)
        scene.write_bytes(b"glTF")
        for name in HABITAT:
            write_agent(DatasetParts(tmp_path, ("hall",)), name, tmp_path / "agents" / name)

        # As StreamVLN's dataset: the frames of an item are those in its folder rgb, in the order of their names.
        folder = tmp_path / "agents" / "streamvln"
        (item,) = load(folder / "train" / "annotations.json")
        frames = folder / "train" / item["video"] / "rgb"
        names = sorted(one.name for one in frames.iterdir())
        assert item["actions"] == [-1, 2, 2, 1, 1] and names == [f"{i:03d}.jpg" for i in range(5)]
        live = LiveScene(row(), "hall", MappingConfig(), None, source.scene, None, None, None)  # type: ignore[arg-type]
        view = ViewSize(640, 480, 2 * math.atan(0.75 * math.tan(math.radians(39.5))), True)
        # As InternNav's: an image of every frame, and what the camera sees 30 degrees down, with its depth.
        scene = tmp_path / "agents" / "internnav" / "traj_data" / "r2r" / "hall"
        videos = scene / "videos" / "chunk-000"
        for i, (place, heading) in enumerate(zip(places, headings)):
            level = frames / f"{i:03d}.jpg"
            assert level.samefile(videos / "observation.images.rgb.125cm_0deg" / f"episode_000000_{i}.jpg")
            lower = videos / "observation.images.rgb.125cm_30deg" / f"episode_000000_{i}.jpg"
            for path, angle in ((level, 0.0), (lower, -math.radians(30))):
                eye = np.array([*place, 1.35])
                expected, depth = LiveImages(live).draw_from(eye, float(heading), angle, view)
                found = cv2.imread(str(path)).astype(float)
                assert found.shape == (480, 640, 3) and np.abs(found - expected).mean() < 3  # random Gaussians
            deep = videos / "observation.images.depth.125cm_30deg" / f"episode_000000_{i}.png"
            meters = cv2.imread(str(deep), cv2.IMREAD_UNCHANGED) / 1000
            assert np.median(np.abs(meters - depth[..., 0] / 4000)) < 0.01
        (about,) = (json.loads(line) for line in (scene / "meta" / "episodes.jsonl").read_text().splitlines())
        assert about == {"episode_index": 0, "tasks": ["Go.<INSTRUCTION_SEP>Walk."], "length": 5}
        assert (scene / "data" / "chunk-000" / "episode_000000.parquet").read_bytes()[:4] == b"PAR1"

        # As habitat-lab's and VLN-CE's datasets, and VLN-CE's nDTW.
        for name, (listed, scenes) in HABITAT.items():
            folder = tmp_path / "agents" / name
            read = [
                gzip.decompress((folder / listed / "train" / f"train{e}.json.gz").read_bytes()) for e in ("", "_gt")
            ]
            found, actions = map(json.loads, read)
            assert list(actions) == [str(one["episode_id"]) for one in found["episodes"]] == ["700", "701"]
            assert all((folder / scenes / one["scene_id"]).is_file() for one in found["episodes"])

        # A second run draws nothing again; another heading does, and a folder of another episode goes.
        drawn = (frames / "000.jpg").stat().st_mtime_ns
        write_frames({"hall": source}, episodes, tmp_path / "frames", ignore_event)
        kept = tmp_path / "frames" / "train" / "hall_r2r_000007"
        assert (kept / "rgb" / "000.jpg").stat().st_mtime_ns == drawn
        turned = replace(
            episode, task=replace(task, path_id=8), walk=ActionPath((2, 0), places[:2], headings[:2] + 0.1)
        )
        turned = replace(turned, floors=episode.floors[:2])
        write_frames({"hall": source}, {"train": [turned]}, tmp_path / "frames", ignore_event)
        assert [one.name for one in (tmp_path / "frames" / "train").iterdir()] == ["hall_r2r_000008"]


def test_a_goal_is_the_farthest_place_that_the_camera_shows_before_the_path_is_hidden() -> None:
    """Twelve steps along +y on a flat floor: a place at distance d is seen atan(1.25 / d) below the horizon."""
    steps = 0.25 * np.arange(13)
    poses = np.column_stack([np.full(13, 2.0), 1 + steps, np.zeros(13), np.zeros(13)])
    episode = DrawnEpisode(Path(), poses)
    focal = 320 / math.tan(math.radians(39.5))
    # The floor, which ends at a wall 2 m ahead of the first frame. All of it is below the horizon of each camera.
    below = math.radians(30) + np.arctan((np.arange(480) + 0.5 - 240) / focal)
    depths = []
    for at in steps:
        floor = 1.25 / np.sin(below) * np.cos(below - math.radians(30))
        wall = (2.0 - at) / np.cos(below) * np.cos(below - math.radians(30))
        depth = np.minimum(floor, wall) if at < 2 else np.full(480, 0.01)
        depths.append(np.repeat(np.rint(depth * 1000).astype(np.uint16)[:, None], 640, axis=1))
    rows = rows_of(episode, [-1, *[1] * 12], depths)
    # Places nearer than 0.67 m are below the image, and those behind the wall are hidden.
    assert rows["relative_goal_frame_id.125cm_30deg"].tolist() == [8, 7, 6, 5, 4, 3, *[-1] * 7]
    for i in (0, 5):
        angle = math.atan(1.25 / (2.0 - steps[i])) - math.radians(30)
        assert rows["goal.125cm_30deg"][i].tolist() == [math.floor(240 + focal * math.tan(angle)), 320]
    assert rows["goal.125cm_30deg"][12].tolist() == [-1, -1]
    # InternNav's robot frame has x ahead: camera to world times (right, down, forward) of the camera, 30 degrees down.
    pose = rows["pose.125cm_30deg"]
    assert np.allclose(pose[1, :3, 3] - pose[0, :3, 3], [0, 0.25, 0])
    assert np.allclose(pose[0, :3, 2], [0, math.cos(math.radians(30)), -0.5])
    assert np.allclose(pose[0, :3, 0], [1, 0, 0])


def test_parquet_files_are_those_that_pyarrow_reads(monkeypatch: pytest.MonkeyPatch) -> None:
    """pyarrow 26.0.1 reads this file as {"a": [-1, 300], "b": [[[0, 1], [2, 3]], [[4, 5], [6, 7]]]}."""
    monkeypatch.setattr("nvsim.dataset.parquet.__version__", "0.2.0")
    columns = {"a": np.array([-1, 300]), "b": np.arange(8.0).reshape(2, 2, 2)}
    assert parquet_bytes(columns).hex() == PARQUET
    with pytest.raises(ValueError, match="same number of rows"):
        parquet_bytes({"a": np.arange(2), "b": np.arange(3)})
    with pytest.raises(ValueError, match="float32"):
        parquet_bytes({"a": np.zeros(2, np.float32)})


def test_scenes_are_written_again_if_their_images_or_clouds_change(
    dataset: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def write(root: Path, out: Path, scans: tuple[str, ...], clouds: dict, listen: object) -> None:
        calls.append(scans)
        for name in ("nvsim.scene_dataset_config.json", "hall/hall.glb"):
            (out / "nvsim" / name).parent.mkdir(parents=True, exist_ok=True)
            (out / "nvsim" / name).write_bytes(b"")

    monkeypatch.setattr("nvsim.dataset.habitat.scene.write_scenes", write)
    record = dataset / "dataset.json"
    before = record.read_text()
    for clouds, times in (({}, 1), ({}, 1), ({"hall": np.zeros((1, 3))}, 2)):
        about = {**json.loads(record.read_text()), "scenes_made_from": _scenes(dataset, ["hall"], clouds, ignore_event)}
        record.write_text(json.dumps(about))
        assert calls == [("hall",)] * times
    record.write_text(before)


def test_a_second_export_keeps_what_the_agent_wrote(dataset: Path) -> None:
    """The folder contains checkpoints and results of an agent."""
    folder = dataset / "agents" / "mapgpt"
    (folder / "mine.txt").write_text("mine")
    command = ["export", "dataset", "--project", str(dataset.parent / "hall.nvsim"), "--out", str(dataset)]
    assert main([*command, "--size", "64", "--projection", *FEW, "--for", "mapgpt"]) == 0
    assert (folder / "mine.txt").read_text() == "mine"


def test_missing_inputs_are_reported_before_any_work(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["export", "dataset", "--project", str(dataset.parent / "hall.nvsim"), "--out", str(tmp_path / "out")]
    assert main([*command, "--for", "duet"]) == 2 and "--vocabulary" in capsys.readouterr().err
    (tmp_path / "vocab.txt").write_text("a\nb\n")
    assert main([*command, "--for", "duet", "--vocabulary", str(tmp_path / "vocab.txt"), "--dry-run"]) == 2
    assert "[CLS]" in capsys.readouterr().err
    assert main([*command, "--for", "mapgpt", "--instructions", "0"]) == 2
    assert "--instructions" in capsys.readouterr().err and not (tmp_path / "out").exists()
    assert main([*command, "--for", "mapgpt", "navgpt2", "--dry-run", "--json", *FEW]) == 0
    kinds = {kind["what"]: kind for kind in json.loads(capsys.readouterr().out)["kinds"]}
    assert kinds["agents"]["files"] >= 10 and "views" in kinds
    monkeypatch.setitem(sys.modules, "lmdb", None)
    assert main([*command, "--for", "navgpt2"]) == 2 and "the extra navgpt2" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


STUBS = {
    "map_nav_src/scripts/run_r2r.sh": "DATA_ROOT=../datasets\n",
    "map_nav_src/scripts/run_r2r_xl.sh": "DATA_ROOT=../datasets\n",
    "finetune_src/r2r/main.py": "",
    "nav_src/NavGPT.py": "",
    "Prevalent/pretrained_model": "",
    "eval_navid_vlnce.sh": "python run.py\n",
    "VLN_CE/habitat_extensions/config/vlnce_task_navid_r2r.yaml": "SCENES_DIR: /raid/data/scene_dataset/\n",
}
"""Files of the agents' repositories that the commands of a README change or enter."""


@pytest.mark.parametrize("name", AGENTS)
def test_the_commands_of_a_readme_run_twice(name: AgentName, tmp_path: Path) -> None:
    """In a checkout, with programs that do nothing in place of python and nvsim."""
    checkout, programs, folder = tmp_path / "checkout", tmp_path / "programs", tmp_path / "agents" / name
    for path, text in STUBS.items():
        (checkout / path).parent.mkdir(parents=True, exist_ok=True)
        (checkout / path).write_text(text)
    (checkout / "data" / "scene_datasets" / "mp3d").mkdir(parents=True)  # data of the user stay
    programs.mkdir()
    for program in ("python", "nvsim"):
        (programs / program).write_text(f'#!/bin/sh\necho {program} "$@" >> "{tmp_path}/calls"\n')
        (programs / program).chmod(0o755)
    for path in ("R2R/annotations/R2R_val_seen_enc.json", "data/R2R_val_seen.json"):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).touch()
    text = readme(AGENTS[name], folder, (tmp_path / "scans", tmp_path / "R2R_val_seen.json"), "val_seen", 7)
    commands, *score = re.findall(r"```bash\n(.*?)```", text, re.DOTALL)
    script = commands.replace("CHECKOUT=...", f"CHECKOUT={checkout}").replace("OUT=...", f"OUT={tmp_path}/results")
    assert "..." not in script.replace("../", "") and "val_unseen" not in script
    for _ in range(2):
        environment = {"PATH": f"{programs}:{os.environ['PATH']}"}
        subprocess.run(["bash", "-euc", "\n".join([script, *score])], env=environment, check=True)
    calls = (tmp_path / "calls").read_text().splitlines()
    assert len(calls) == 2 * (1 + len(score)) and (calls[1].startswith("nvsim evaluate r2r --scans") if score else True)
    assert (checkout / "data" / "scene_datasets" / "mp3d").is_dir()
    links = [path for path in checkout.rglob("*") if path.is_symlink()]
    assert all(Path(os.readlink(path)) == folder / path.relative_to(checkout) for path in links)
    assert all(path.name not in os.listdir(os.readlink(path)) for path in links if path.is_dir())


def test_a_readme_names_only_splits_that_its_agent_has() -> None:
    for name, agent in AGENTS.items():
        text = readme(agent, Path("/folder"), (Path("/scans"), Path("/tasks")), "val_unseen", 7)
        assert ("val_train_seen" in text) == (name in ON_GRAPHS), name


def test_agents_with_results_write_and_score_all_instructions() -> None:
    texts = {
        name: readme(agent, Path("/folder"), (Path("/scans"), Path("/tasks.json")), "val_unseen", 7)
        for name, agent in AGENTS.items()
    }
    scored = {name for name, text in texts.items() if "nvsim evaluate r2r --scans /scans --tasks /tasks.json" in text}
    assert scored == {"duet", "hamt", "recurrent-vln-bert", "mapgpt", "navgpt", "navgpt2"}
    assert "--save_pred" in texts["mapgpt"] and "--iters 7" in texts["navgpt"]


@pytest.mark.parametrize("name", AGENTS)
def test_the_page_lists_the_files_of_every_agent(name: AgentName) -> None:
    page = Path(__file__).parents[2] / "resources" / "docs" / "tasks.md"
    (line,) = [line for line in page.read_text().splitlines() if line.startswith(f"| `{name}` | `")]
    _, listed, ran = line.strip(" |").split(" | ")
    expected = [pattern.replace("{split}", "SPLIT").replace("{scan}", "SCAN") for pattern in AGENTS[name].files]
    expected = [path.replace("{steps}", "SPLIT") for path in expected]
    assert listed == ", ".join(f"`{path}`" for path in expected) and ran == AGENTS[name].ran


PARQUET = (
    "504152311500152015202c15041500150615060000ffffffffffffffff2c01000000000000150015b40115b4012c1510150015061506"
    "000010000000020002020201020202000202020102020200000010020000000000000000000000000000f03f00000000000000400000"
    "0000000008400000000000001040000000000000144000000000000018400000000000001c401502197c4806736368656d6115040015"
    "0425001801610035001801621502150600350418046c69737415020035001807656c656d656e741502150600350418046c6973741502"
    "00150a25001807656c656d656e74001604191c192c26081c15041925000619180161150016041642164226080000264a1c150a192500"
    "0619580162046c69737407656c656d656e74046c69737407656c656d656e741500161016da0116da01264a0000169c02160400280b6e"
    "7673696d20302e322e3000bd00000050415231"
)

# Numbers by BertWordPieceTokenizer of tokenizers 0.23.3, lower case, with this vocabulary.
ENCODED = {
    "Turn LEFT, then 2.5 metres.": [2, 83, 84, 41, 23, 54, 51, 60, 32, 40, 35, 16, 51, 66, 64, 51, 87, 40, 3],
    "Doorways\u00a0and\tdoors": [2, 85, 86, 87, 4, 60, 50, 85, 87, 3],
    "Caf\u00e9 \u00c0 la \u201ccarte\u201d": [2, 6, 47, 52, 51, 4, 15, 47, 1, 6, 47, 64, 66, 51, 1, 3],
    "can't stop-now!": [2, 6, 47, 60, 45, 23, 22, 66, 61, 62, 44, 17, 61, 69, 42, 3],
    "\u9580\u53e3 a\u200bb\ufffdc": [2, 1, 1, 4, 48, 49, 3],
    "a" * 100 + " " + "a" * 101: [2, 4, *[47] * 99, 1, 3],
    "x_y=z": [2, 27, 1, 28, 1, 29, 3],
    "": [2, 3],
}


@pytest.mark.parametrize("text", ENCODED)
def test_word_pieces_are_those_of_the_package_tokenizers(tmp_path: Path, text: str) -> None:
    (tmp_path / "vocab.txt").write_text("\n".join(PIECES) + "\n")
    assert Vocabulary.read(tmp_path / "vocab.txt").encode(text) == ENCODED[text]
