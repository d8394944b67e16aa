"""What a network of surface normals takes and gives: known of two common exports, else said in a file beside it.

Of the exports that the community makes of Metric3D v2, `pixel_values` takes 0 to 255 and sides of multiples of 28
(YvanYin/Metric3D, issue 117); MoGe-2's own ones take `image`, 0 to 1, of any size, and `num_tokens` (microsoft/MoGe,
docs/onnx.md). Both give unit normals in OpenCV's frame, towards the camera. Others differ in sign, axes and range.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import read_bytes

Three = tuple[float, float, float]


@dataclass(frozen=True)
class NormalsForm:
    """white       what the network takes for a channel that is full: 1 or 255
    mean, std   are subtracted from it and divided by, per channel
    axes        factors that turn the output to x right, y down, z forward, out of the surface towards the camera
    halved      whether the output is (n + 1) / 2
    multiple    pixels that the sides of an image are a multiple of, where the network takes any size
    """

    white: float = 1.0
    mean: Three = (0.0, 0.0, 0.0)
    std: Three = (1.0, 1.0, 1.0)
    axes: Three = (1.0, 1.0, 1.0)
    halved: bool = False
    multiple: int = 1


def form_of(path: Path, inputs: set[str]) -> NormalsForm:
    """Of the network at `path` whose inputs have these names. Raises InputError where it is neither known nor said, or
    what is said makes no sense."""
    beside = path.with_suffix(".toml")
    if beside.is_file():
        return _said(beside)
    if "num_tokens" in inputs:
        return NormalsForm()
    if "pixel_values" in inputs:
        return NormalsForm(white=255.0, multiple=28)
    raise InputError(f"{path} is neither Metric3D nor MoGe; say in {beside.name} beside it what it takes and gives.")


def _said(path: Path) -> NormalsForm:
    with reading(path, "a TOML file"):
        said = tomllib.loads(read_bytes(path).decode())
    known = {field.name for field in fields(NormalsForm)}
    for name in said:
        if name not in known:
            raise InputError(f"{path} says {name!r:.40}, which is unknown; it takes {', '.join(sorted(known))}.")
    values = {name: _value(path, name, value) for name, value in said.items()}
    form = NormalsForm(**values)
    if form.white <= 0 or min(form.std) <= 0 or not 1 <= form.multiple <= 1024 or 0 in form.axes:
        raise InputError(f"{path}: white and std must be positive, multiple 1 to 1024, and no axis 0.")
    return form


def _value(path: Path, name: str, value: Any) -> Any:
    """The value as the field of that name has it. Raises InputError where it is of another kind."""
    if name == "halved" and type(value) is bool:
        return value
    if name == "multiple" and type(value) is int:
        return value
    if name == "white" and type(value) in (int, float):
        return float(value)
    numbers = isinstance(value, list) and len(value) == 3 and all(type(v) in (int, float) for v in value)
    if name in ("mean", "std", "axes") and numbers:
        return tuple(map(float, value))
    raise InputError(f"{path} says {name} = {value!r:.40}; three numbers, a number or true is what it takes.")
