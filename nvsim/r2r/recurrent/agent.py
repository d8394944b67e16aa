"""Runs a trained agent through the episodes of tasks."""

from __future__ import annotations

from pathlib import Path

from nvsim.errors import InputError
from nvsim.r2r.agents.benchmark import Benchmark
from nvsim.r2r.features.feature_reading import made_by
from nvsim.r2r.metrics.submission import Pose
from nvsim.r2r.recurrent.dataset import episodes_of
from nvsim.r2r.recurrent.rollout import walked
from nvsim.r2r.recurrent.saved_agent import read_about, read_model
from nvsim.r2r.recurrent.world_reading import Source, read_world


def run_recurrent(folder: Path, benchmark: Benchmark, features: Path) -> dict[str, list[Pose]]:
    """Returns the trajectory of every episode of the benchmark by instr_id, for the agent in `folder`.

    Raises InputError if the agent is unreadable, or the features differ from those of its training.
    """
    about = read_about(folder)
    backbone = made_by(features)
    if about.backbone and backbone and backbone != about.backbone:
        raise InputError(
            f"The agent was trained on features of {about.backbone}, but {features} has features of {backbone}; write "
            "features of the first with `nvsim export features`."
        )
    world = read_world([Source(benchmark.graphs, features)], about.model.panorama)
    if world.width != about.features:
        raise InputError(
            f"The agent reads {about.features} numbers per view, but {features} has {world.width}; name a file in the "
            "layout of its training."
        )
    model = read_model(folder, about)
    episodes = episodes_of(benchmark.tasks, world, about.words, about.model.longest)
    return dict(walked(model, world, episodes, about.steps))
