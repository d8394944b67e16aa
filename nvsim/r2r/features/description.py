"""What a TOML file says about the ONNX network beside it: CLIP.toml about CLIP.onnx."""

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
    """name         what to call the network in the files it makes
    width        numbers of an image that its output has, or of each of its rows
    tokens       rows of an image that its output has, 1 where they are pooled
    preparation  what it takes
    output       the name of its output, None where it has one only
    classes      the name of a second output with 1000 logits, None where there is none
    """

    name: str
    width: int
    preparation: Preparation
    output: str | None = None
    classes: str | None = None
    tokens: int = 1


def read_description(model: Path) -> Description:
    """The description beside `model`. Raises InputError where it is missing, is no TOML, lacks `width` or `size`, or
    says something that is not known."""
    path = model.with_suffix(".toml")
    if not path.is_file():
        raise InputError(f"{path} is missing; say in it what {model.name} takes and gives, at least {_EXAMPLE}.")
    return parse_description(read_text(path, "a description of a network", "save it as UTF-8", LARGEST), path)


def parse_description(text: str, path: Path) -> Description:
    """The description in `text`, from the file `path`. Raises InputError with the key that is wrong."""
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
