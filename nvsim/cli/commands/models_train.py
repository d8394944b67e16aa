"""Train a network of floor and surface normals in the way the bundled one was trained: on generated interiors, and on
photographs and renders of projects, labeled by their point clouds.

Continues a stopped training, and a finished one if you give more steps. Needs pip install "nvsim[train-networks]".
Install the result with `nvsim models add FOLDER/semantic.toml FOLDER/interior.onnx --name NAME`, and likewise with
normals.toml."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline, Positional
from nvsim.recipes.config import RecipeConfig


@dataclass(frozen=True)
class Arguments:
    folder: Positional[Path]
    """Folder for examples, checkpoints and the network; 25 MB per interior."""
    projects: tuple[Path, ...] = ()
    """Projects with a scan or with depth of images, and with floor masks. Trained projects also give renders."""
    start: Path | None = None
    """The folder of another training, or its ONNX file. Training starts from its weights."""
    json: bool = False
    """Print events as JSON lines."""
    config: Inline[RecipeConfig] = field(default_factory=RecipeConfig)


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if an option is out of range."""
    from nvsim.cli.console import listening
    from nvsim.errors import InputError

    a, c = arguments, arguments.config
    for name, least in (("steps", 1), ("interiors", 1), ("views", 1), ("captured", 1), ("batch", 1), ("threads", 1)):
        if getattr(c, name) < least:
            raise InputError(f"--{name.replace('_', '-')} {getattr(c, name)} is too small; give {least} or more.")
    if not 0 <= c.captures_share < 1:
        raise InputError(f"--captures-share {c.captures_share} is out of range; give 0 or more, and less than 1.")
    if c.save_every < 1:
        raise InputError(f"--save-every {c.save_every} is too small; give 1 or more.")
    from nvsim.recipes.making import make

    with listening(a.json) as listen:
        make(a.folder, c, a.projects, a.start, listen)
    return 0
