"""The descriptions that come with NVSim, one for each form in which models of the three roles are exported."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import resources
from nvsim.errors import InputError, shown
from nvsim.files.regular import read_text
from nvsim.networks.binding import bind
from nvsim.networks.description import Description, Role
from nvsim.networks.onnx_session import Signature
from nvsim.networks.parsing import description_in
from nvsim.networks.toml_table import LARGEST, parsed

FOLDER = Path(resources.__file__).parent / "models"
_AGAIN = "save it as UTF-8"


@cache
def ready() -> dict[str, Description]:
    """The descriptions by the name of their form, such as "sam2-samexporter"."""
    return {form: description_in(values_of(FOLDER / f"{form}.toml"), FOLDER / f"{form}.toml") for form in _forms()}


@cache
def _forms() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def values_of(path: Path) -> dict[str, Any]:
    """The parsed TOML at `path`. If it names a form (`form = "moge-2"`), missing keys are taken from that form. Raises
    InputError if the file cannot be read or the form is unknown."""
    values = parsed(read_text(path, "a description of a model", _AGAIN, LARGEST), path)
    form = values.pop("form", None)
    if form is None:
        return values
    known = _forms()
    if form not in known:
        raise InputError(f"{path}: form is {shown(form)}; it must be one of {', '.join(known)}.")
    return {**values_of(FOLDER / f"{form}.toml"), **values}


def read_description(path: Path) -> Description:
    """The description in the TOML at `path`. Raises InputError if it is invalid."""
    return description_in(values_of(path), path)


def fitting(signatures: dict[Path, Signature], role: Role | None = None) -> list[tuple[str, dict[str, Path]]]:
    """The forms that match all files with these `signatures`: name of the form, and path of each of its files.

    Forms with the most tensors known by name are first."""
    found = []
    for name, description in ready().items():
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
                for b in bind(tensors, nodes, files[step.file], inputs)
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
