"""Train a network of floor and surface normals as the one that comes with NVSim was: on generated interiors, and on
photographs and renders of projects, labelled by their clouds.

Goes on where it was stopped, and with more steps where it had ended. Needs pip install "nvsim[train-networks]". Install
the result with `nvsim models add FOLDER/semantic.toml FOLDER/interior.onnx --name NAME`, and normals.toml likewise."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline, Positional
from nvsim.recipes.config import RecipeConfig


@dataclass(frozen=True)
class Arguments:
    folder: Positional[Path]
    """Where examples, checkpoint and network go; 25 MB an interior."""
    projects: tuple[Path, ...] = ()
    """Projects with a scan, or depth of images, and floors; renders are made of those that are trained."""
    start: Path | None = None
    """The folder of another training, or its ONNX file, with whose weights this one begins."""
    json: bool = False
    """Print typed events as JSON lines."""
    config: Inline[RecipeConfig] = field(default_factory=RecipeConfig)


def run(arguments: Arguments) -> int:
    from nvsim.cli.console import listening
    from nvsim.errors import InputError

    a, c = arguments, arguments.config
    for name, least in (("steps", 1), ("interiors", 1), ("views", 1), ("captured", 1), ("batch", 1), ("threads", 1)):
        if getattr(c, name) < least:
            raise InputError(f"--{name.replace('_', '-')} {getattr(c, name)} is too little; say {least} or more.")
    if not 0 <= c.captures_share < 1:
        raise InputError(f"--captures-share {c.captures_share} is no share; say 0 or more, below 1.")
    if c.save_every < 1:
        raise InputError(f"--save-every {c.save_every} is too little; say 1 or more.")
    from nvsim.recipes.making import make

    with listening(a.json) as listen:
        make(a.folder, c, a.projects, a.start, listen)
    return 0
