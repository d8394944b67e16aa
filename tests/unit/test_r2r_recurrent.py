"""The recurrent agent learns, sees what a simulator would show, and is trained alike whether it is killed or not."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from recurrent_samples import FEATURES, QUICK, SMALL, dataset, write_features
from task_samples import as_agents_load, house

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.events import Event, ignore_event
from nvsim.graph.connectivity import read_connectivity, scan_files
from nvsim.r2r.features.candidates import HEADINGS
from nvsim.r2r.features.feature_files import RowSource, features_of, write_tsv
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig
from nvsim.r2r.recurrent.dataset import Vocabulary, held_out, read_dataset, split_words
from nvsim.r2r.recurrent.rollout import (
    AgentBatch,
    Rollout,
    RolloutStep,
    angle_feature,
    read_words,
    roll_out,
    run_greedily,
)
from nvsim.r2r.recurrent.saved_agent import read_agent_description, read_model
from nvsim.r2r.recurrent.trainer import Trainer, actor_critic, imitation_loss, rewards_of, teacher_actions
from nvsim.r2r.recurrent.training import CHECKPOINT, read_curves, train_agent
from nvsim.r2r.recurrent.world import STOP, World, read_world


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset(tmp_path_factory.mktemp("recurrent"))


@pytest.fixture(scope="module")
def trainer(folder: Path) -> Trainer:
    """Not to be trained."""
    return Trainer(read_dataset([folder]), SMALL, QUICK)


def test_words_numbers_and_marks_are_words() -> None:
    assert split_words("Don’t turn LEFT, walk 2.5 metres; stop.") == [
        *("don’t", "turn", "left", ",", "walk", "2.5", "metres", ";", "stop", ".")
    ]
    words = Vocabulary.of(["go left", "go left now"])
    assert words.words == ("[pad]", "[begin]", "[end]", "[unknown]", "go", "left")
    assert words.encoded("Go right left left", longest=3) == [1, 4, 3, 5, 2]


def test_angles_are_said_as_agents_of_r2r_say_them() -> None:
    h, e = 0.7, -0.3
    four = [math.sin(h), math.cos(h), math.sin(e), math.cos(e)]
    assert angle_feature(np.array([h]), np.array([e]))[0] == pytest.approx(four)
    assert angle_feature(np.array([h]), np.array([e]), 128)[0] == pytest.approx(four * 32)


@pytest.fixture(scope="module")
def world(folder: Path) -> World:
    """Where agents may go everywhere."""
    return read_world(read_dataset([folder]).sources, panorama=False)


def test_the_agent_sees_each_neighbor_where_it_is(folder: Path, world: World) -> None:
    graph = read_connectivity(scan_files(folder)["H1"])
    stored = dict(features_of(folder / "features" / FEATURES, [("H1", id) for id in graph.viewpoints]))
    for id, viewpoint in graph.viewpoints.items():
        at, here = world.row["H1", id], np.array(viewpoint.position)
        there = {world.keys[t][1]: k for k, t in enumerate(world.target[at]) if t >= 0}
        assert set(there) == set(graph.neighbors(id))
        for other, k in there.items():
            way = np.array(graph.viewpoints[other].position) - here
            heading, level = math.atan2(way[0], way[1]), math.hypot(way[0], way[1])
            assert math.remainder(world.heading[at, k] - heading, 2 * math.pi) == pytest.approx(0, abs=1e-5)
            assert world.elevation[at, k] == pytest.approx(math.atan2(way[2], level), abs=1e-5)
            assert world.distance[at, k] == pytest.approx(np.linalg.norm(way), abs=1e-5)
            # Of level neighbors the view that looks nearest to them shows them.
            view = 12 + int(np.argmin(np.abs((HEADINGS[12:24] - heading + math.pi) % (2 * math.pi) - math.pi)))
            row = stored["H1", id][view]
            assert world.features[world.seen[at, k]] == pytest.approx((row - row.mean()) / row.std(), abs=1e-4)


def test_the_teacher_leads_along_the_shortest_path(folder: Path, world: World) -> None:
    import networkx as nx

    graph = as_agents_load(read_connectivity(scan_files(folder)["H0"]))
    far = dict(nx.all_pairs_dijkstra_path_length(graph))
    ids = sorted(graph)
    for goal in ids[::5]:
        here = np.array([world.row["H0", id] for id in ids])
        goals = np.full(len(here), world.row["H0", goal])
        assert world.meters(here, goals) == pytest.approx([far[id][goal] for id in ids], abs=1e-5)
        for id, after in zip(ids, world.rows_after(here, world.shortest_path_slots(here, goals)).tolist()):
            on = world.keys[after][1]
            step = 0.0 if on == id else graph.edges[id, on]["weight"]
            assert (on == id) == (id == goal) and step + far[on][goal] == pytest.approx(far[id][goal], abs=1e-5)


def test_moves_are_felt_and_end_in_the_trajectory(trainer: Trainer) -> None:
    world, episodes = trainer.world, trainer.train[:4]
    walkers = AgentBatch(world, episodes, 4)
    assert walkers.observe(np.arange(4)).moved.tolist() == [[0, 0, 0, 0, 1, 0]] * 4
    looked, at, everybody = walkers.heading.copy(), walkers.rows.copy(), np.arange(4)
    walkers.move(everybody, np.array([STOP, 1, 1, 1]))
    moved = walkers.observe(everybody).moved.numpy()
    assert moved[0].tolist() == [0, 0, 0, 0, 1, 0] and [len(t) for t in walkers.trajectories] == [1, 2, 2, 2]
    for i in (1, 2, 3):
        heading, meters = world.heading[at[i], 0], world.distance[at[i], 0]
        said = [math.sin(heading - looked[i]), math.cos(heading - looked[i]), 0, meters / 5, 0, meters / 5]
        assert moved[i] == pytest.approx(said, abs=1e-5)
        assert walkers.trajectories[i][1][0] == world.keys[world.target[at[i], 0]][1]
        assert math.cos(walkers.trajectories[i][1][1] - heading) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("panorama", [False, True])
def test_a_batch_does_what_each_does_alone(folder: Path, panorama: bool) -> None:
    trainer = Trainer(read_dataset([folder]), replace(SMALL, panorama=panorama), QUICK)
    model, world = trainer.model.eval(), trainer.world
    ordered = sorted(trainer.train, key=lambda e: (len(e.path), len(e.words)))
    episodes = [*ordered[:3], *ordered[-3:]]
    assert len({len(e.words) for e in episodes}) > 2 and len({len(e.path) for e in episodes}) > 1
    with torch.inference_mode():
        together = roll_out(model, world, episodes, read_words(model, episodes), "path", 0)
        for i, episode in enumerate(episodes):
            alone = roll_out(model, world, [episode], read_words(model, [episode]), "path", 0)
            mine = [
                step.scores[int(np.flatnonzero(step.agents == i)[0])] for step in together.steps if i in step.agents
            ]
            assert len(mine) == len(alone.steps) == len(episode.path)
            for ours, theirs in zip(mine, (step.scores[0] for step in alone.steps)):
                assert torch.allclose(ours[: len(theirs)], theirs, atol=1e-5) and ours[len(theirs) :].isneginf().all()


def test_gradients_reach_every_part(folder: Path) -> None:
    trainer = Trainer(read_dataset([folder]), replace(SMALL, panorama=True), QUICK)
    episodes, model, world = trainer.train[:8], trainer.model, trainer.world
    read = read_words(model, episodes)
    own = roll_out(model, world, episodes, read, "mixed", 8, critic=True)
    loss = imitation_loss(own, teacher_actions(own, world, episodes, "mixed"))
    (loss + actor_critic(own, rewards_of(own, world, episodes), QUICK)).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name


def test_losses_are_those_of_their_formulas(trainer: Trainer) -> None:
    scores = torch.tensor([[1.0, 0.0, -math.inf], [0.0, 2.0, 1.0]], requires_grad=True)
    last = torch.tensor([[0.5, 0.0]], requires_grad=True)
    steps = [
        RolloutStep(np.array([0, 1]), np.array([0, 0]), scores, torch.tensor([0.5, -1.0]), np.array([0, 2])),
        RolloutStep(np.array([1]), np.array([0]), last, torch.tensor([0.25]), np.array([0])),
    ]
    rollout = Rollout(AgentBatch(trainer.world, trainer.train[:2], 4), steps)
    p0, p1, p2 = scores[0, :2].softmax(0), scores[1].softmax(0), last[0].softmax(0)
    known = -(p0[1].log() + p2[1].log()) / 2
    assert imitation_loss(rollout, [np.array([1, -1]), np.array([1])]).item() == pytest.approx(known.item(), abs=1e-6)
    rewards = [np.array([-2, 1], np.float32), np.array([2], np.float32)]
    expected = 0.0
    for p, slot, value, gain in ((p0, 0, 0.5, -2.0), (p1, 2, -1.0, 1 + 0.9 * 2.0), (p2, 0, 0.25, 2.0)):
        p, advantage = p.detach().numpy(), gain - value
        expected += -math.log(p[slot]) * advantage + advantage**2 / 2 + 0.01 * float((p * np.log(p)).sum())
    assert actor_critic(rollout, rewards, LearningConfig()).item() == pytest.approx(expected / 3, abs=1e-5)


def test_rewards_are_for_coming_nearer_and_for_stopping_there(trainer: Trainer) -> None:
    world, episode = trainer.world, trainer.train[0]
    episodes = [episode, episode]
    found = roll_out(trainer.model, world, episodes, read_words(trainer.model, episodes), "path", 0)
    assert [r.tolist() for r in rewards_of(found, world, episodes)] == [[1, 1]] * (len(episode.path) - 1) + [[2, 2]]
    begin = np.array([episode.path[0]] * 2)
    back = RolloutStep(np.arange(2), begin, found.steps[0].scores, None, np.array([STOP, STOP]))
    assert rewards_of(Rollout(found.walkers, [back]), world, episodes)[0].tolist() == [-2, -2]


def test_a_dozen_paths_are_learnt_by_heart(tmp_path: Path) -> None:
    learning = replace(QUICK, iterations=1000, batch=12, warm_up=10, rate=3e-3)
    trainer = Trainer(read_dataset([dataset(tmp_path, scans=1, paths=14, width=8)]), SMALL, learning)
    del trainer.train[24:]
    assert len({e.path for e in trainer.train}) == 12
    begin = time.process_time()
    reached = 0
    while reached < len(trainer.train) and trainer.at.step < learning.iterations:
        for _ in range(25):
            trainer.batch()
        ends = dict(run_greedily(trainer.model, trainer.world, trainer.train, 15))
        reached = sum(ends[e.instr_id][-1][0] == e.task.path[-1] for e in trainer.train)
    assert reached == len(trainer.train), f"{reached} after {time.process_time() - begin:.0f} s"


def test_a_blind_agent_is_told_nothing_not_even_how_much_was_said(folder: Path) -> None:
    trainer = Trainer(read_dataset([folder]), replace(SMALL, blind=True), QUICK)
    model = trainer.model.eval()
    short, *_, long = sorted(trainer.train, key=lambda e: len(e.words))
    assert len(short.words) < len(long.words)
    text, state = read_words(model, [short, long])
    assert torch.equal(state[0], state[1]) and torch.equal(text.tokens[0], text.tokens[1]) and text.tokens.shape[1] == 2


def test_distances_can_be_kept_from_the_agent(folder: Path) -> None:
    trainer = Trainer(read_dataset([folder]), replace(SMALL, distances=False), QUICK)
    before = dict(run_greedily(trainer.model, trainer.world, trainer.train[:20], 15))
    trainer.world.distance *= 3
    assert dict(run_greedily(trainer.model, trainer.world, trainer.train[:20], 15)) == before


def test_whole_scans_are_held_out_and_paths_where_there_are_few(folder: Path, tmp_path: Path) -> None:
    tasks = read_dataset([folder]).tasks
    train, out = held_out(tasks, 0.1, 0)
    assert len({t.scan for t in out}) == 1 and not {t.scan for t in out} & {t.scan for t in train}
    train, out = held_out([t for t in tasks if t.scan != "H0"], 0.1, 0)
    assert not {t.path_id for t in out} & {t.path_id for t in train}
    assert len(out) == math.ceil(0.1 * (len(train) + len(out)))


def test_nobody_in_training_enters_what_is_unseen(folder: Path, trainer: Trainer) -> None:
    unseen = json.loads((folder / "tasks" / "tasks.json").read_text())["unseen"]
    rows = {trainer.world.row[scan, id] for scan, ids in unseen.items() for id in ids}
    assert rows and not rows & set(trainer.world.target.ravel().tolist())


def test_only_the_train_split_is_opened_of_a_whole_dataset(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / "scans").mkdir()
    (copy / "connectivity").rename(copy / "scans" / "connectivity")
    for split in ("val_seen", "val_unseen"):
        (copy / "tasks" / f"R2R_{split}.json").write_text("damaged")
    train_agent(read_dataset([copy]), SMALL, replace(QUICK, iterations=2), tmp_path / "agent", ignore_event)


def test_a_killed_training_goes_on_to_the_same_bits(folder: Path, tmp_path: Path) -> None:
    learning = replace(QUICK, iterations=20, a2c_iterations=10, patience=100)
    data = read_dataset([folder])
    whole = train_agent(data, SMALL, learning, tmp_path / "whole", ignore_event)

    class Killed(BaseException):
        pass

    def kill_at(*steps: int):  # type: ignore[no-untyped-def]
        def listen(event: Event) -> None:
            if getattr(event, "name", "") == "loss" and event.step in steps:  # type: ignore[union-attr]
                raise Killed

        return listen

    for step in (10, 20, 30):
        with pytest.raises(Killed):
            train_agent(data, SMALL, learning, tmp_path / "killed", kill_at(step))
        assert (tmp_path / "killed" / CHECKPOINT).exists()
    assert train_agent(data, SMALL, learning, tmp_path / "killed", ignore_event) == whole
    for name in ("weights.safetensors", "curves.jsonl", "agent.json"):
        assert (tmp_path / "killed" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes(), name
    assert not (tmp_path / "killed" / CHECKPOINT).exists()
    steps = [metric.step for metric in read_curves(tmp_path / "killed") if metric.name == "loss"]
    assert steps == [10, 20, 30]


def test_kill_minus_nine_leaves_what_the_command_goes_on_from(folder: Path, tmp_path: Path) -> None:
    words = [
        "r2r",
        "train",
        "--scans",
        str(folder),
        "--width",
        "32",
        "--heads",
        "2",
        "--iterations",
        "24",
        "--batch",
        "8",
    ]
    words += ["--evaluate-every", "6", "--checkpoint-every", "2", "--threads", "1"]
    out = tmp_path / "killed"
    process = subprocess.Popen(
        [sys.executable, "-m", "nvsim", *words, "--out", str(out)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    end = time.monotonic() + 120
    while not (out / CHECKPOINT).exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert (out / CHECKPOINT).exists() and not read_agent_description(out).finished
    assert main([*words, "--out", str(out)]) == 0
    assert main([*words, "--out", str(tmp_path / "whole")]) == 0
    for name in ("weights.safetensors", "curves.jsonl"):
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_trained_agent_walks_and_is_scored(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    agent, out = tmp_path / "agent", tmp_path / "submission.json"
    words = ["--width", "32", "--heads", "2", "--iterations", "4", "--batch", "8", "--threads", "1"]
    assert main(["r2r", "train", "--scans", str(folder), "--out", str(agent), *words]) == 0
    assert main(["r2r", "train", "--scans", str(folder), "--out", str(agent), *words]) == 0
    assert "is already trained" in capsys.readouterr().err
    common = ["r2r", "agent", "recurrent", "--scans", str(folder), "--out", str(out)]
    assert main([*common, "--checkpoint", str(agent), "--split", "val_unseen"]) == 0
    tasks = str(folder / "tasks" / "R2R_val_unseen.json")
    capsys.readouterr()
    assert main(["evaluate", "r2r", "--scans", str(folder), "--tasks", tasks, "--submission", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["agents"]["submission"]["instructions"] == 12
    for trajectory in json.loads(out.read_text()):
        assert len(trajectory["trajectory"]) <= 16
        assert all(a[0] != b[0] for a, b in pairwise(trajectory["trajectory"]))


def test_wrong_orders_are_refused_in_one_sentence(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    agent = tmp_path / "agent"
    train_agent(read_dataset([folder]), SMALL, replace(QUICK, iterations=1), agent, ignore_event)
    common = ["r2r", "agent", "recurrent", "--scans", str(folder), "--out", str(tmp_path / "x.json")]
    graphs = [house(f"H{i}", rooms=2, seed=i) for i in range(3)]
    other = write_features(tmp_path / "other.hdf5", graphs, 16, "another network")
    narrow = write_features(tmp_path / "narrow.hdf5", graphs, 8)
    few = write_features(tmp_path / "few.hdf5", graphs[:1], 16)
    named = [*common, "--split", "val_unseen", "--checkpoint", str(agent)]
    train = ["r2r", "train", "--scans", str(folder), "--out", str(agent)]
    twice = ["r2r", "train", "--scans", str(folder), str(folder), "--out", str(agent)]
    bare = tmp_path / "bare"
    shutil.copytree(folder / "connectivity", bare / "connectivity")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "weights.safetensors").write_text("mine")
    for words, said in (
        ([*common, "--split", "val_unseen"], "needs --checkpoint"),
        ([*common, "--checkpoint", str(agent)], "Give either --tasks"),
        ([*named, "--features", str(other)], "trained on features of chance"),
        ([*named, "--features", str(narrow)], "reads 16 numbers"),
        ([*named, "--features", str(few)], "has no features of"),
        ([*common, "--split", "val_unseen", "--checkpoint", str(folder)], "agent.json"),
        (train, "an agent with other data or options"),
        (twice, "is in two of the folders"),
        ([*twice, "--features", str(other), str(narrow)], "an agent needs features of one network"),
        ([*train[:-1], str(tmp_path / "mine")], "belongs to no agent"),
        ([*train, "--tasks", str(tmp_path), str(tmp_path)], "--tasks has 2 values for 1"),
        ([*train, "--width", "33"], "multiple of --heads"),
        (
            ["r2r", "train", "--scans", str(tmp_path), "--out", str(tmp_path / "y")],
            "R2R_train.json does not exist; write",
        ),
        ([*common, "--split", "nowhere", "--checkpoint", str(agent)], "R2R_nowhere.json does not exist; write"),
        ([*train, "--scans", str(bare), "--tasks", str(folder / "tasks")], f"features {bare}`, or give --features"),
    ):
        assert main(words) == 2, words
        assert said in (error := capsys.readouterr().err) and "Traceback" not in error, (words, error)
    assert not (tmp_path / "x.json").exists() and not (tmp_path / "y").exists()


def test_damaged_agents_are_refused(folder: Path, tmp_path: Path) -> None:
    agent = tmp_path / "agent"
    train_agent(read_dataset([folder]), SMALL, replace(QUICK, iterations=1), agent, ignore_event)
    about = json.loads((agent / "agent.json").read_text())
    for change in (
        {"model": {**about["model"], "width": "32"}},
        {"model": {**about["model"], "more": 1}},
        {"words": ["a"]},
        {"features": 1 << 40},
        {"agent": "other"},
    ):
        (agent / "agent.json").write_text(json.dumps({**about, **change}))
        with pytest.raises(InputError):
            read_agent_description(agent)
    (agent / "agent.json").write_text(json.dumps({**about, "features": 17}))
    with pytest.raises(InputError, match="weights"):
        read_model(agent, read_agent_description(agent))
    (agent / "weights.safetensors").write_bytes(b"\x00" * 100)
    with pytest.raises(InputError, match="weights"):
        read_model(agent, read_agent_description(agent))


def test_features_come_back_from_either_format(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    rows = {("S", f"v{i}"): random.standard_normal((36, 5)).astype(np.float32) for i in range(4)}
    placed = [(RowSource(*key, (64, 48)), row) for key, row in rows.items()]
    write_tsv(tmp_path / "x.tsv", placed, {"backbone": "b"}, 60)
    for wanted in (list(rows), [("S", "v2")]):
        found = dict(features_of(tmp_path / "x.tsv", wanted))
        assert set(found) == set(wanted) and all(np.array_equal(found[key], rows[key]) for key in wanted)
    with pytest.raises(InputError, match="has no features of 1 viewpoints, the first S_v9"):
        list(features_of(tmp_path / "x.tsv", [("S", "v1"), ("S", "v9")]))


def test_links_in_a_file_of_features_are_not_followed(tmp_path: Path) -> None:
    import h5py

    with h5py.File(tmp_path / "secret.hdf5", "w") as file:
        file["S_v"] = np.zeros((36, 4), np.float32)
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        file["S_v"] = h5py.ExternalLink("secret.hdf5", "S_v")
        file["S_odd"] = np.zeros((35, 4), np.float32)
    with pytest.raises(InputError, match="no features"):
        list(features_of(tmp_path / "x.hdf5", [("S", "v")]))
    with pytest.raises(InputError, match="not 36 rows"):
        list(features_of(tmp_path / "x.hdf5", [("S", "odd")]))


def test_a_model_is_refused_that_cannot_be() -> None:
    for wrong in ({"width": 0}, {"heads": 5}, {"angle_size": 6}, {"dropout": 1.0}):
        with pytest.raises(InputError):
            ModelConfig(**wrong)  # type: ignore[arg-type]
    options = ("rate", "a2c_rate", "warm_up", "weight_decay", "a2c_teacher", "entropy", "discount")
    negative = [{name: value} for name in options for value in (-0.5, math.nan)]
    for wrong in ({"iterations": 0}, {"held_out": 0.0}, {"batch": 0}, {"discount": 1.5}, *negative):
        with pytest.raises(InputError):
            LearningConfig(**wrong)  # type: ignore[arg-type]
