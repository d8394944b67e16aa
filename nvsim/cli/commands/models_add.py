"""Install a network: the ONNX files of one model, or their folder, are copied into the models folder with the
description that they fit, after the model has been opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    paths: Positional[tuple[Path, ...]]
    """The ONNX files of one model, with its TOML where it has one, or the folder that holds them."""
    name: str = ""
    """What to call it; without one, what its files are named after."""
    form: str = ""
    """The ready description that it follows, such as sam2-osam; without one, the one whose tensors it has."""
    replace: bool = False
    """Put it in the place of the model that has this name."""


def run(arguments: Arguments) -> int:
    from nvsim.networks.adding import add
    from nvsim.networks.roles import IMPROVES, ROLE_WORDS

    model = add(arguments.paths, arguments.name, arguments.form, arguments.replace)
    assert model.description is not None
    say(f"{model.name} is installed in {model.folder}: {model.description.title}")
    say(f"It gives {ROLE_WORDS[model.role]} and improves {IMPROVES[model.role]}.")
    return 0
