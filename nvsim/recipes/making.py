"""Runs the complete recipe: examples, training, export. Each part continues after an interruption."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import torch

from nvsim.errors import InputError
from nvsim.events import Done, Listener, Progress, ignore_event
from nvsim.project.project import Project
from nvsim.r2r.features.trunk import need_weights
from nvsim.recipes.captures import name_of, photographs, renders
from nvsim.recipes.config import RecipeConfig
from nvsim.recipes.examples import Example, Shards, is_complete_shard, write_shard
from nvsim.recipes.interiors import interior
from nvsim.recipes.network import export
from nvsim.recipes.training import STAGE, train, weights_of

_UPRIGHT_EVERY = 5
"""Every fifth building has upright images."""


def make(
    folder: Path, config: RecipeConfig, projects: Sequence[Path] = (), start: Path | None = None,
    listen: Listener = ignore_event,
) -> Path:  # fmt: skip
    """Makes examples, trains a network in `folder`, and returns the path of its ONNX file.

    projects  projects with a dense cloud and floors that provide more examples
    start     folder of another training, or its ONNX file, with the initial weights

    Raises InputError if the weights of the trunk or of `start` are missing, or two projects have one name.
    """
    need_weights()
    if start is not None:
        weights_of(start)  # raises before examples are made
    if len({name_of(p) for p in projects}) < len(projects):
        raise InputError("Two projects have the same name; rename one, because the name is the folder of its examples.")
    examples = folder / "examples"
    shards, shares = _interiors(examples, config, listen)
    groups = [_of_project(examples / name_of(p), p, config, listen) for p in projects]
    for group in groups:
        shards += group
    shares += _captured_shares([len(group) for group in groups], config)
    torch.set_num_threads(config.threads)
    network = train(folder, Shards(shards), shares, config, start, listen)
    path = export(network, folder)
    listen(Done(STAGE, f"{path} after {config.steps} steps on {len(shards)} sets of examples", {"file": str(path)}))
    return path


def _captured_shares(counts: Sequence[int], config: RecipeConfig) -> list[float]:
    """A weight for each shard of the projects, where a generated building has weight 1. `counts` has the number of
    shards of each project. Projects with shards have equal weights, and `captures_share` together."""
    filled = [count for count in counts if count]
    whole = config.captures_share / (1 - config.captures_share) * config.interiors
    return [whole / len(filled) / count for count in filled for _ in range(count)]


def _interiors(folder: Path, config: RecipeConfig, listen: Listener) -> tuple[list[Path], list[float]]:
    paths = []
    for number in range(config.interiors):
        listen(Progress(STAGE, number, config.interiors, "interiors"))
        upright = number % _UPRIGHT_EVERY == _UPRIGHT_EVERY - 1
        path = folder / "interiors" / f"{number:05d}-{config.views}"
        if not is_complete_shard(path):
            write_shard(path, interior(number, config.views, upright))
        paths.append(path)
    return paths, [1.0] * len(paths)


def _of_project(folder: Path, project: Path, config: RecipeConfig, listen: Listener) -> list[Path]:
    """A project's shards, each with examples of one size. Raises InputError if the project cannot be labeled."""
    sources: dict[str, Callable[[Project], Iterator[Example]]] = {
        "photographs": lambda opened: photographs(opened, config.captured),
        "renders": lambda opened: renders(opened, config.captured, config.seed),
    }
    found = []
    for number, (name, source) in enumerate(sources.items()):
        listen(Progress(STAGE, number, len(sources), f"{name_of(project)}: {name}"))
        done = folder / f"{name}-{config.captured}"
        if not is_complete_shard(done):
            with Project.open(project) as opened:
                examples = list(source(opened))
            sizes = dict.fromkeys(e.image.shape for e in examples)
            for k, size in enumerate(sizes):
                write_shard(done / str(k), [e for e in examples if e.image.shape == size])
            write_shard(done, [])
        found += sorted(path for path in done.iterdir() if path.is_dir())
    return found
