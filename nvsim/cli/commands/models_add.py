"""Install a network: copy the ONNX files of one model, or their folder, into the models folder with a matching
description. The model is opened first to test it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    paths: Positional[tuple[Path, ...]]
    """The ONNX files of one model, with its TOML file if there is one, or the folder that contains them."""
    name: str = ""
    """Name of the model. Default: taken from its file names."""
    form: str = ""
    """The built-in description to use, such as sam2-osam. Default: the one whose tensors match."""
    replace: bool = False
    """Replace an installed model of this name."""


def run(arguments: Arguments) -> int:
    from nvsim.networks.adding import add
    from nvsim.networks.roles import IMPROVES, ROLE_WORDS

    model = add(arguments.paths, arguments.name, arguments.form, arguments.replace)
    assert model.description is not None
    say(f"{model.name} is installed in {model.folder}: {model.description.title}")
    say(f"It gives {ROLE_WORDS[model.role]} and improves {IMPROVES[model.role]}.")
    return 0
