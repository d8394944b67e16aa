"""Run the unchanged environments of published agents on NVSim's simulator: teacher and random episodes in a made scan.

    nvsim r2r python -- python tests/benchmarks/agent_environments.py recurrent|duet|mapgpt CHECKOUT

CHECKOUT is a clone of YicongHong/Recurrent-VLN-BERT, cshizhe/VLN-DUET or chen-judge/MapGPT. They need these packages:
networkx, torch (Recurrent-VLN-BERT), h5py and jsonlines (VLN-DUET). The image features are random numbers.
"""

from __future__ import annotations

import json
import os
import random
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import networkx as nx
import numpy as np
import tyro

from nvsim.benchmarks.simulator import write_made_scan

STUB, STUB_ID = "ZMojNkEp431", "2f4d90acd4024c269fb0efe49a8ac540"
"""A scan and a viewpoint that two of the agents name in their code; the scan made here has another geometry."""


@dataclass(frozen=True)
class Arguments:
    agent: tyro.conf.Positional[Literal["recurrent", "duet", "mapgpt"]]
    checkout: tyro.conf.Positional[Path]
    episodes: int = 32


def main() -> None:
    given = tyro.cli(Arguments, description=__doc__)
    checkout = given.checkout.resolve()
    with tempfile.TemporaryDirectory() as made:
        os.chdir(made)  # the agents read and write in the working directory
        sys.argv = [sys.argv[0]]
        data = _write_scans(Path(made), given.episodes)
        env = {"recurrent": _recurrent, "duet": _duet, "mapgpt": _mapgpt}[given.agent](checkout, Path(made), data)
        random.seed(1)
        for name, choose in (("teacher", _teacher), ("random", _any)):
            reached, moves = _walk(env, choose)
            print(f"{given.agent}, {name}: {len(data)} episodes, {moves} moves, {reached} at the goal")
            if name == "teacher" and not reached == len(env.data) == len(data):
                sys.exit(1)


def _write_scans(folder: Path, count: int) -> list[dict[str, Any]]:
    write_made_scan(folder, "made", count=60, plain=True)
    write_made_scan(folder, STUB, count=2, plain=True)
    path = folder / "connectivity" / f"{STUB}_connectivity.json"
    entries = json.loads(path.read_text())
    entries[0]["image_id"] = STUB_ID
    path.write_text(json.dumps(entries))
    entries = json.loads((folder / "connectivity" / "made_connectivity.json").read_text())
    graph = nx.Graph()
    for a in entries:
        for b, free in zip(entries, a["unobstructed"], strict=True):
            if free:
                graph.add_edge(a["image_id"], b["image_id"], weight=float(np.linalg.norm(_place(a) - _place(b))))
    r, found = np.random.default_rng(0), []
    parts = sorted(nx.connected_components(graph), key=len)[-1]
    ids = sorted(parts)
    while len(found) < count:
        start, goal = r.choice(ids, 2, replace=False)
        path_ids = nx.dijkstra_path(graph, str(start), str(goal))
        item = {"scan": "made", "path": path_ids, "path_id": len(found), "heading": float(r.uniform(0, 6.28))}
        instruction = {"instr_id": f"{len(found)}_0", "instruction": "go", "instructions": ["go straight to the end"]}
        found.append(item | instruction | {"instr_encoding": [101, 102], "distance": 1.0})
    return found


def _place(entry: dict[str, Any]) -> Any:
    return np.array([entry["pose"][k] for k in (3, 7, 11)])


def _features(folder: Path, size: int) -> dict[str, Any]:
    entries = json.loads((folder / "connectivity" / "made_connectivity.json").read_text())
    r = np.random.default_rng(0)
    return {f"made_{e['image_id']}": r.normal(size=(36, size)).astype(np.float32) for e in entries}


def _recurrent(checkout: Path, folder: Path, data: list[dict[str, Any]]) -> Any:
    sys.path.insert(0, str(checkout / "r2r_src"))
    (folder / "data").mkdir()
    (folder / "data" / "R2R_train.json").write_text(json.dumps(data))
    from env import R2RBatch  # type: ignore[import-not-found]

    words = SimpleNamespace(tokenize=str.split, convert_tokens_to_ids=lambda tokens: [1] * len(tokens))
    return R2RBatch(_features(folder, 2048), batch_size=8, splits=["train"], tokenizer=words)


def _duet(checkout: Path, folder: Path, data: list[dict[str, Any]]) -> Any:
    sys.path.insert(0, str(checkout / "map_nav_src"))
    import h5py  # type: ignore[import-not-found]

    with h5py.File(folder / "features.hdf5", "w") as file:
        for key, values in _features(folder, 768).items():
            file[key] = values
    from r2r.env import R2RNavBatch  # type: ignore[import-not-found]
    from utils.data import ImageFeaturesDB  # type: ignore[import-not-found]

    features = ImageFeaturesDB(str(folder / "features.hdf5"), 768)
    return R2RNavBatch(features, data, str(folder / "connectivity"), batch_size=8)


def _mapgpt(checkout: Path, folder: Path, data: list[dict[str, Any]]) -> Any:
    sys.path.insert(0, str(checkout))
    from vln.env import R2RNavBatch  # type: ignore[import-not-found]

    more = SimpleNamespace(scan_data_dir=None, img_root=str(folder))
    return R2RNavBatch(data, str(folder / "connectivity"), batch_size=8, args=more)


def _walk(env: Any, choose: Any) -> tuple[int, int]:
    """Runs every episode once. Returns the number of episodes that end at the goal, and the total number of moves."""
    env.reset_epoch()
    reached = moves = 0
    for _ in range(len(env.data) // env.batch_size):
        seen = env.reset()
        for _ in range(40):
            targets = [choose(env, ob) for ob in seen]
            if not any(targets):
                break
            for i, target in enumerate(targets):
                if target is not None:
                    _go(env.env.sims[i], target)
                    moves += 1
            seen = env._get_obs()
            for ob, target in zip(seen, targets, strict=True):
                assert target is None or ob["viewpoint"] == target["viewpointId"]
        reached += sum(ob["viewpoint"] == ob["gt_path"][-1] for ob in seen)
    return reached, moves


def _teacher(env: Any, ob: dict[str, Any]) -> Any:
    goal = ob["gt_path"][-1]
    if ob["viewpoint"] == goal:
        return None
    paths = env.paths if hasattr(env, "paths") else env.shortest_paths
    following = paths[ob["scan"]][ob["viewpoint"]][goal][1]
    return next(c for c in ob["candidate"] if c["viewpointId"] == following)


def _any(env: Any, ob: dict[str, Any]) -> Any:
    return random.choice(ob["candidate"])


def _go(sim: Any, candidate: dict[str, Any]) -> None:
    """Moves as the agents do: turns step by step to the view that shows the candidate best, then goes to it."""

    def act(*action: float) -> Any:
        batched = [[value] for value in action] if isinstance(sim.getState(), list) else action
        sim.makeAction(*batched)
        return state()

    def state() -> Any:
        found = sim.getState()
        return found[0] if isinstance(found, list) else found

    view = candidate["pointId"]
    while state().viewIndex // 12 != view // 12:
        act(0, 0, 1 if state().viewIndex // 12 < view // 12 else -1)
    while state().viewIndex != view:
        act(0, 1, 0)
    assert state().navigableLocations[candidate["idx"]].viewpointId == candidate["viewpointId"]
    act(candidate["idx"], 0, 0)


if __name__ == "__main__":
    main()
