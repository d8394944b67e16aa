"""Parse the TOML of a model into a Description, or refuse it with the name of the wrong key."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, get_args

from nvsim.errors import InputError
from nvsim.networks.description import (
    Constant,
    Description,
    Direction,
    FeaturesResult,
    File,
    FloorResult,
    Frame,
    Kind,
    MaskResult,
    Meaning,
    NormalsResult,
    Points,
    Result,
    Role,
    Scheduler,
    Step,
    Tensor,
    given_values,
)
from nvsim.networks.image_preparation import preparation_in
from nvsim.networks.toml_table import TomlTable

_PERPENDICULAR = ({"right", "left"}, {"down", "up"}, {"forward", "backward"})
_MOST_SIDE = 1 << 16
_OBJECT, _MOST_OBJECTS = re.compile(r"[a-z]+([ -][a-z]+)*"), 200
_LONGEST_NAME = 255  # bytes; the limit of common file systems for a file name
T = TypeVar("T")


def description_in(values: dict[str, Any], path: Path) -> Description:
    """The description in the parsed TOML `values` of the file `path`. Raises InputError if a key is wrong."""
    table = TomlTable(values, path)
    role: Role = table.one_of("role", get_args(Role))
    steps = table.tables("steps")
    description = Description(
        role=role,
        title=table.word("title", path.stem),
        files=_read_tables(table.table("files"), _file),
        images=_read_tables(table.table("images"), lambda t: preparation_in(t, needs_size=False)),
        steps=tuple(map(_step, steps)),
        result=_result(table.table("result"), role),
        points=_points(table.table("points")) if role == "prompted" else None,
        constants=_read_tables(table.table("constants"), _constant),
        schedulers=_read_tables(table.table("schedulers"), _scheduler),
        names=table.words("names", ()),
        made_by=table.word("made_by", ""),
        licence=table.word("licence", ""),
        source=table.word("source", ""),
    )
    table.refuse_others()
    _check(description, path)
    return description


def _read_tables(table: TomlTable, read: Callable[[TomlTable], T]) -> dict[str, T]:
    found = {}
    for key in table.keys():  # noqa: SIM118  (a Table is not a dict)
        inner = table.table(key)
        found[key] = read(inner)
        inner.refuse_others()
    return found


def _file(table: TomlTable) -> File:
    name = table.word("file")
    beside = table.words("beside", ())
    for each in (name, *beside):
        if Path(each).name != each or each.startswith(".") or len(os.fsencode(each)) > _LONGEST_NAME:
            right = f"the name of a file beside the description, at most {_LONGEST_NAME} bytes"
            raise table.error("file" if each == name else "beside", right)
    return File(name, beside, table.word("sha256", ""))


def _step(table: TomlTable) -> Step:
    inputs, outputs = (
        tuple(_tensor(t, several=key == "inputs") for t in table.tables(key)) for key in ("inputs", "outputs")
    )
    step = Step(table.word("file"), inputs, outputs, table.word("loop", ""))
    table.refuse_others()
    return step


def _tensor(table: TomlTable, several: bool) -> Tensor:
    tensor = Tensor(
        table.words("value") if several else (table.word("value"),),
        table.words("name", ()),
        table.integers("shape", _MOST_SIDE) if "shape" in table else None,
        table.one_of("kind", get_args(Kind)[1:], ""),
        table.flag("optional", False),
        table.number("factor", 1.0, positive=False),
        table.integer("item", 1024, least=0) if "item" in table else None,
        table.integer("copies", 64, 1),
    )
    if not tensor.names and tensor.shape is None:
        raise table.error("name", "the name of the tensor in the file; without a name, give its shape")
    table.refuse_others()
    return tensor


def _constant(table: TomlTable) -> Constant:
    shape = table.integers("shape", _MOST_SIDE) if "shape" in table else None
    if "seed" in table:
        seed = table.integer("seed", 1 << 30, least=0)
        return Constant((), shape, seed, table.word("like", ""), table.integer("copies", 64, 1))
    if "needed" in table and "value" not in table:
        return Constant(needed=table.word("needed"))
    numbers = table.numbers("value")
    size = 1
    for side in shape or ():
        size *= side
    if shape is not None and (size > 1 << 24 or len(numbers) not in (1, size)):
        raise table.error("value", f"one number, or {size}, as the shape requires")
    return Constant(numbers, shape)


def _scheduler(table: TomlTable) -> Scheduler:
    least, most = table.number("first_beta", Scheduler.first_beta), table.number("last_beta", Scheduler.last_beta)
    trained = table.integer("trained", 10_000, Scheduler.trained)
    if not 0 < least <= most < 1:
        raise table.error("last_beta", "below 1, and not below first_beta")
    return Scheduler(
        state=table.word("state"),
        prediction=table.word("prediction"),
        predicts=table.one_of("predicts", ("epsilon", "v_prediction", "sample")),
        steps=table.integer("steps", trained, min(Scheduler.steps, trained)),
        trained=trained,
        first_beta=least,
        last_beta=most,
        betas=table.one_of("betas", ("scaled_linear", "linear"), Scheduler.betas),
        spacing=table.one_of("spacing", ("leading", "trailing"), Scheduler.spacing),
        offset=table.integer("offset", trained, Scheduler.offset, least=0),
        ends_at_one=table.flag("ends_at_one", Scheduler.ends_at_one),
    )


def _points(table: TomlTable) -> Points:
    points = Points(table.word("image", ""), table.flag("padding", False), table.flag("negatives", True))
    table.refuse_others()
    return points


def _result(table: TomlTable, role: Role) -> Result:
    value, image = table.word("value"), table.word("image", "")
    result: Result
    if role == "prompted":
        single = table.one_of("single", ("skip", "best", "first"), MaskResult.single)
        result = MaskResult(value, image, table.word("scores", ""), single)
    elif role == "features":
        result = FeaturesResult(
            value, image, table.word("descriptors"), table.word("scores", ""), table.word("matches", ""),
            table.word("match_scores", ""), table.number("least", FeaturesResult.least),
        )  # fmt: skip
    elif role == "normals":
        result = NormalsResult(
            value, image, _axes(table), _channels_last(table), table.flag("halved", False),
            table.word("there", ""), table.number("least", NormalsResult.least),
            table.one_of("frame", get_args(Frame), NormalsResult.frame),
        )  # fmt: skip
    else:
        classes = table.integer("classes", 100_000, 1)
        floor = table.integers("floor", classes - 1, (0,) if classes == 1 else None)
        result = FloorResult(
            value, image, table.one_of("meaning", get_args(Meaning)), _channels_last(table), classes, floor,
            table.word("scores", ""), table.integers("people", classes - 1, ()),
            _objects(table.table("objects"), classes),
        )  # fmt: skip
    table.refuse_others()
    return result


def _objects(table: TomlTable, classes: int) -> tuple[tuple[str, tuple[int, ...]], ...]:
    """The names of objects and their classes. Raises InputError if there are too many, or a name is not plain words."""
    names = table.keys()
    for name in names:
        if not _OBJECT.fullmatch(name):
            raise table.error(name, "named with lower-case English words")
    if len(names) > _MOST_OBJECTS:
        raise table.error(names[_MOST_OBJECTS], f"left out, because a network names at most {_MOST_OBJECTS} objects")
    return tuple((name, table.integers(name, classes - 1)) for name in names)


def _channels_last(table: TomlTable) -> bool:
    return bool(table.one_of("layout", ("NCHW", "NHWC"), "NCHW") == "NHWC")


def _axes(table: TomlTable) -> tuple[Direction, Direction, Direction]:
    axes = table.words("axes")
    right = "three of right or left, down or up, forward or backward, each once, out of the surface"
    if len(axes) != 3 or not all(sum(a in pair for a in axes) == 1 for pair in _PERPENDICULAR):
        raise table.error("axes", right)
    first, second, third = axes
    return first, second, third  # type: ignore[return-value]


def _check(d: Description, path: Path) -> None:
    """Raises InputError if a name refers to nothing."""

    def require_known(name: str, known: tuple[str, ...], what: str) -> None:
        if name not in known:
            raise InputError(f"{path}: {what} {name!r:.60} is unknown; it must be one of {', '.join(known) or 'none'}.")

    if not d.files or not d.images or not d.steps:
        missing = "files" if not d.files else "images" if not d.images else "steps"
        raise InputError(f"{path}: {missing} is missing; a description has files, images, steps and result.")
    known = (*d.images, *d.constants, *given_values(d.role))
    for constant in d.constants.values():
        if constant.like:  # it is created when that value exists
            require_known(constant.like, tuple(v for s in d.steps for t in s.outputs for v in t.values), "the value")
    for step in d.steps:
        require_known(step.file, tuple(d.files), "the file")
        if step.loop:
            require_known(step.loop, tuple(d.schedulers), "the scheduler")
        for tensor in step.inputs:
            for name in tensor.values:
                require_known(name, known, "the value")
        known += tuple(v for tensor in step.outputs for v in tensor.values)
        if step.loop:
            require_known(d.schedulers[step.loop].prediction, known, "the value")
            require_known(d.schedulers[step.loop].state, known, "the value")
    result = d.result
    require_known(result.value, known, "the value")
    if result.image or not isinstance(result, MaskResult):
        require_known(result.image, tuple(d.images), "the image")
    for key in ("scores", "there", "descriptors", "matches", "match_scores"):
        if getattr(result, key, ""):
            require_known(getattr(result, key), known, "the value")
    if d.points is not None and d.points.image:
        require_known(d.points.image, tuple(d.images), "the image")
