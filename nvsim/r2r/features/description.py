"""Reads the TOML file that describes an ONNX network: CLIP.toml describes CLIP.onnx."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.regular import read_text
from nvsim.networks.preparing import Preparation, preparation_in
from nvsim.networks.toml_table import LARGEST, Table, parsed

MOST_WIDTH = 65536
_EXAMPLE = "width = 512 and size = [224, 224]"


@dataclass(frozen=True)
class Description:
    """The description of a network.

    name         name of the network, stored in the features files
    width        numbers for each image in the output, or in each of its rows
    tokens       rows for each image in the output, 1 if they are pooled
    preparation  the input of the network
    output       name of the output, None if there is only one
    classes      name of a second output with 1000 logits, None if there is none
    """

    name: str
    width: int
    preparation: Preparation
    output: str | None = None
    classes: str | None = None
    tokens: int = 1


def read_description(model: Path) -> Description:
    """Reads the description of `model`.

    Raises InputError if the file is missing, is not TOML, lacks `width` or `size`, or has an unknown key or value.
    """
    path = model.with_suffix(".toml")
    if not path.is_file():
        raise InputError(f"{path} is missing; describe the input and output of {model.name}, at least {_EXAMPLE}.")
    return parse_description(read_text(path, "a description of a network", "save it as UTF-8", LARGEST), path)


def parse_description(text: str, path: Path) -> Description:
    """Reads a description from `text`, the content of the file `path`. Raises InputError with the wrong key."""
    table = Table(parsed(text, path), path)
    description = Description(
        name=table.word("name", path.stem),
        width=table.whole("width", MOST_WIDTH),
        preparation=preparation_in(table),
        output=table.word("output", "") or None,
        classes=table.word("classes", "") or None,
        tokens=table.whole("tokens", MOST_WIDTH, 1),
    )
    table.refuse_others()
    return description
