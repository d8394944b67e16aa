"""The environments keep Gymnasium's contract, alone and many at once."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from nvsim.benchmarks.simulator import write_made_scan
from nvsim.r2r.simulator.gym import GraphEnv


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    write_made_scan(folder, count=12, side=32, plain=True)
    return folder


def options(folder: Path) -> dict[str, object]:
    size = {"width": 32, "height": 24, "render_mode": "rgb_array"}
    return {"dataset": folder / "scans", "graphs": folder / "connectivity", **size}


def test_the_graph_environment_keeps_the_contract(made: Path) -> None:
    env = gymnasium.make("nvsim/Graph-v0", **options(made))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(env.unwrapped)
    env.reset(seed=1)
    assert env.render().shape == (24, 32, 3)


def test_two_environments_walk_side_by_side(made: Path) -> None:
    envs = gymnasium.make_vec("nvsim/Graph-v0", num_envs=2, vectorization_mode="sync", **options(made))
    seen, _ = envs.reset(seed=3)
    assert seen["rgb"].shape == (2, 24, 32, 3)
    _, rewards, _, _, _ = envs.step(envs.action_space.sample())
    assert rewards.shape == (2,)
    envs.close()


def test_the_rewards_of_a_walk_to_the_goal_add_up_to_its_length(made: Path) -> None:
    env = GraphEnv(made / "scans", made / "connectivity", images=False)
    _, info = env.reset(seed=5)
    length, total, done = info["way_left"], 0.0, False
    while info["way_left"] > 1e-6:
        ways = []
        for k in range(1, len(env.state.navigableLocations)):
            place = env.state.navigableLocations[k]
            ways.append(env._ways[place.ix] + place.rel_distance)
        _, reward, done, _, info = env.step(np.int64(1 + int(np.argmin(ways))))
        total += reward
    assert length > 0 and math.isclose(total, length, abs_tol=1e-4) and not done
    _, reward, done, _, info = env.step(np.int64(0))
    assert done and info["success"] and reward == 1.0


def test_an_action_that_there_is_none_of_changes_nothing(made: Path) -> None:
    env = GraphEnv(made / "scans", made / "connectivity", images=False)
    _, info = env.reset(seed=2)
    _, reward, _, _, after = env.step(np.int64(15))
    assert after["invalid"] and reward == 0.0 and after["position"] == info["position"]
    assert info["action_mask"][15] == 0
