"""Descriptions of networks without a description of their own: the forms that come with NVSim, and known exports of
normals.

The names of the tensors come from the ONNX file.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import nvsim_resources
from nvsim.errors import InputError, value_text
from nvsim.files.opening import read_text
from nvsim.networks.binding import bind_tensors, describe_nodes
from nvsim.networks.description import Description, Role
from nvsim.networks.onnx_session import Node, Signature
from nvsim.networks.parsing import description_in
from nvsim.networks.toml_table import LARGEST, TomlTable, parse_toml

FOLDER = Path(nvsim_resources.__file__).parent / "models"
_AGAIN = "save it as UTF-8"


@cache
def known_descriptions() -> dict[str, Description]:
    """The descriptions by the name of their form, such as "sam2-samexporter"."""
    return {form: description_in(values_of(FOLDER / f"{form}.toml"), FOLDER / f"{form}.toml") for form in _forms()}


@cache
def _forms() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def values_of(path: Path) -> dict[str, Any]:
    """The parsed TOML at `path`. If it names a form (`form = "moge-2"`), missing keys are taken from that form. Raises
    InputError if the file cannot be read or the form is unknown."""
    values = parse_toml(read_text(path, "a description of a model", _AGAIN, LARGEST), path)
    form = values.pop("form", None)
    if form is None:
        return values
    known = _forms()
    if form not in known:
        raise InputError(f"{path}: form is {value_text(form)}; it must be one of {', '.join(known)}.")
    return {**values_of(FOLDER / f"{form}.toml"), **values}


def read_description(path: Path) -> Description:
    """The description in the TOML at `path`. Raises InputError if it is invalid."""
    return description_in(values_of(path), path)


def matching_forms(signatures: dict[Path, Signature], role: Role | None = None) -> list[tuple[str, dict[str, Path]]]:
    """The forms that match all files with these `signatures`: name of the form, and path of each of its files.

    Forms with the most tensors known by name are first."""
    found = []
    for name, description in known_descriptions().items():
        if role in (None, description.role) and len(description.files) == len(signatures):
            fit = _fit(description, signatures)
            if fit is not None:
                found.append((fit[0], name, fit[1]))
    return [(name, files) for _, name, files in sorted(found, key=lambda f: -f[0])]


def _fit(description: Description, signatures: dict[Path, Signature]) -> tuple[int, dict[str, Path]] | None:
    """The number of tensors known by name, and the path of each file; None if the description does not match."""
    from itertools import permutations

    best = None
    for paths in permutations(signatures):
        files = dict(zip(description.files, paths, strict=True))
        try:
            bound = [
                b
                for step in description.steps
                for tensors, nodes, inputs in zip(
                    (step.inputs, step.outputs), signatures[files[step.file]], (True, False), strict=True
                )
                for b in bind_tensors(tensors, nodes, files[step.file], inputs)
            ]
        except InputError:
            continue
        inputs_of = {id(t) for step in description.steps for t in step.inputs}
        if any(id(b.tensor) in inputs_of and b.tensor.names and b.node.name not in b.tensor.names for b in bound):
            continue  # an input that is prepared differently has the same shape; only its name distinguishes it
        named = sum(b.node.name in b.tensor.names for b in bound)
        if best is None or named > best[0]:
            best = named, files
    return best


_FLOATS = ("tensor(float)", "tensor(float16)")
_GRAY = (0.485, 0.456, 0.406)
_AXES = (("left", "right"), ("up", "down"), ("backward", "forward"))
KEYS = ("white", "mean", "std", "axes", "halved", "multiple")


def description_from_legacy_toml(
    path: Path, network: Path, inputs: Sequence[Node], outputs: Sequence[Node]
) -> dict[str, Any]:
    """The description of the `network`, as parsed TOML, from the six keys in the file at `path`.

    `inputs` and `outputs` are those of the network. Raises InputError if the file or the network does not fit."""
    values = parse_toml(read_text(path, "a description of a network", "save it as UTF-8", LARGEST), path)
    for key in values:
        if key not in KEYS:
            raise InputError(f"{path} has the unknown key {key!r:.40}; the known keys are {', '.join(KEYS)}.")
    table = TomlTable(values, path)
    white = table.number("white", 1.0)
    axes = table.three("axes", (1.0, 1.0, 1.0))
    if 0 in axes:
        raise InputError(f"{path}: axes is {list(axes)}; no axis may be 0.")
    image = [i for i in inputs if len(i.shape) == 4 and i.type in _FLOATS]
    if len(image) != 1 or len(inputs) != 1:
        raise InputError(
            f"{network} takes {describe_nodes(inputs)}; a network for normals takes one image of shape (1, 3, H, W)."
        )
    output, last = _output(outputs, network)
    return {
        "role": "normals",
        "title": path.stem,
        "files": {"network": {"file": network.name}},
        "images": {
            "photo": {
                "resize": "centre", "interpolation": "linear", "brightest": white,
                "mean": list(table.three("mean", (0.0, 0.0, 0.0))),
                "std": list(table.three("std", (1.0, 1.0, 1.0), positive=True)),
                "pad": [255 * part for part in _GRAY], "multiple": table.integer("multiple", 1024, 1),
            }
        },
        "steps": [
            {
                "file": "network", "inputs": [{"value": "photo", "name": image[0].name}],
                "outputs": [{"value": "normals", "name": output.name}],
            }
        ],
        "result": {
            "value": "normals", "image": "photo", "layout": "NHWC" if last else "NCHW",
            "halved": table.flag("halved", False), "axes": [pair[a > 0] for pair, a in zip(_AXES, axes, strict=True)],
        },
    }  # fmt: skip


def _output(outputs: Sequence[Node], network: Path) -> tuple[Node, bool]:
    """The output with normals, and whether its channels are last."""
    named = [o for o in outputs if "normal" in o.name and "conf" not in o.name] or list(outputs)
    for node in named:
        shape = list(node.shape)
        if len(shape) == 4 and (shape[1] in (3, 4) or shape[3] in (3, 4)):
            return node, shape[1] not in (3, 4)
    raise InputError(f"{network} gives no normals, three or four values for each pixel; export those too.")
