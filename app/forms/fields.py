"""The options of a command as a flat list of fields, read from its Arguments dataclass. Knows no Qt."""

from __future__ import annotations

import ast
import dataclasses
import functools
import importlib
import inspect
import re
import textwrap
import types
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from nvsim.cli.main import COMMANDS

# Given by the window, standing above the form, or no way to start a job.
LEFT_OUT = ("project", "json", "dry_run", "capture", "preset", "config.name")
Kind = Literal["number", "count", "switch", "choice", "path", "text", "several"]


@dataclass(frozen=True)
class Field:
    """One option of a command.

    path      dotted, as in the dataclass: "config.loss.ssim"
    flag      as on the command line: "--loss.ssim"
    section   heading it stands under, "" for the command itself
    optional  whether it may be left open (None)
    choices   of a "choice"; of a "several" that has a choice
    item      of "several": the type of one
    """

    path: str
    flag: str
    name: str
    section: str
    kind: Kind
    default: Any
    help: str = ""
    unit: str = ""
    optional: bool = False
    choices: tuple[str, ...] = ()
    item: type = str


def command_of(verb: str) -> types.ModuleType:
    """The module of `nvsim VERB`."""
    return importlib.import_module(f"nvsim.cli.commands.{COMMANDS[verb][0]}")


def presets_of(verb: str) -> tuple[str, ...]:
    """The names that --preset takes; () where there is no such option."""
    hints = typing.get_type_hints(command_of(verb).Arguments)
    return typing.get_args(hints["preset"]) if "preset" in hints else ()


def fields_of(verb: str, preset: str = "") -> list[Field]:
    """All options of a command, with the defaults of `preset`."""
    command = command_of(verb)
    hints = typing.get_type_hints(command.Arguments)
    if hasattr(command, "defaults"):
        base = command.defaults(["--preset", preset] if preset else [])
        values = {f.name: getattr(base, f.name) for f in dataclasses.fields(base)}
    else:
        values = {f.name: _default(f) for f in dataclasses.fields(command.Arguments)}
    found: list[Field] = []
    _walk(command.Arguments, values, "", "", "", found)
    known = [f for f in found if f.path not in LEFT_OUT]
    return [f for f in known if f.path.partition(".")[0] in hints]


def paper_values(verb: str) -> dict[str, Any]:
    """Path -> the paper's value, where a preset of the command stands for the paper."""
    names = presets_of(verb)
    paper = next((n for n in ("paper", "splatfacto-i") if n in names), None)
    return {} if paper is None else {f.path: f.default for f in fields_of(verb, paper)}


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return field.default
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return None


def _walk(cls: type, values: dict[str, Any], path: str, prefix: str, section: str, found: list[Field]) -> None:
    hints = typing.get_type_hints(cls, include_extras=True)
    docs = field_docs(cls)
    for field in dataclasses.fields(cls):
        hint, inline, positional = _plain(hints[field.name])
        here, value = f"{path}{field.name}", values[field.name]
        flag = f"{prefix}{field.name.replace('_', '-')}"
        if dataclasses.is_dataclass(hint):
            inner = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
            title = section if inline else _title(field.name)
            if section and not inline:
                title = f"{section}: {_title(field.name)}"
            _walk(typing.cast(type, hint), inner, f"{here}.", prefix if inline else f"{flag}.", title, found)
        elif not positional:
            found.append(_field(hint, here, f"--{flag}", field.name, section, value, docs.get(field.name, "")))


def _plain(hint: object) -> tuple[object, bool, bool]:
    """The type without its annotations; whether its fields are flags without a prefix; whether it has no flag."""
    inline = positional = False
    while typing.get_origin(hint) is typing.Annotated:
        hint, *notes = typing.get_args(hint)
        inline |= any(getattr(n, "name", None) == "" for n in notes)
        positional |= any("Positional" in str(n) for n in notes)
    return hint, inline, positional


def _field(hint: object, path: str, flag: str, name: str, section: str, default: object, help: str) -> Field:
    optional = False
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        inner = [a for a in typing.get_args(hint) if a is not type(None)]
        optional, (hint, _, _) = len(inner) < len(typing.get_args(hint)), _plain(inner[0])
    choices: tuple[str, ...] = ()
    item: type = str
    kind: Kind = "text"
    origin = typing.get_origin(hint)
    if origin is Literal:
        kind, choices = "choice", tuple(str(a) for a in typing.get_args(hint))
    elif origin is tuple:
        kind, inside = "several", typing.get_args(hint)[0]
        if typing.get_origin(inside) is Literal:
            choices = tuple(str(a) for a in typing.get_args(inside))
        elif isinstance(inside, type):
            item = inside
    elif hint is bool:
        kind = "switch"
    elif hint is int:
        kind = "count"
    elif hint is float:
        kind = "number"
    elif isinstance(hint, type) and issubclass(hint, Path):
        kind = "path"
    return Field(
        path, flag, _title(name), section, kind, default, help, unit_of(name, help, kind), optional, choices, item
    )


def _title(name: str) -> str:
    words = " ".join(word.upper() if word in _SHORT else word for word in name.removesuffix("_gb").split("_"))
    return words[:1].upper() + words[1:]


def unit_of(name: str, help: str, kind: Kind) -> str:
    """The unit that the first sentence of the help of a number names."""
    if kind not in ("number", "count") or help.startswith(("Weight", "Cost")):
        return ""
    if name.endswith("_gb"):
        return "GB"
    first_sentence = re.split(r"(?<=\.)\s", help, maxsplit=1)[0]
    words = re.sub(r"square met(re|er)s", "", first_sentence)
    for pattern, unit in _UNITS:
        if re.search(pattern, words):
            return unit
    return ""


_SHORT = ("vlnce", "ssim", "lpips", "csv", "sh", "mcmc", "dc")
_UNITS = (
    (r"^Met(re|er)s per unit", "m per unit"),
    (r"(?i)(^|: |\b(in|of) |, )met(re|er)s\b|\bmet(re|er)s[:;.]", "m"),
    (r"^Degrees\b|\bin degrees\b", "°"),
    (r"\bpixels\.|^Pixels\b", "px"),
    (r"^GiB\b", "GiB"),
    (r"^(Least time|Seconds)\b|\bseconds[.;]", "s"),
)


@functools.cache
def field_docs(cls: type) -> dict[str, str]:
    """Field -> the string below it in the source, its own and those it inherits. Empty where there is no source."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        try:
            tree = ast.parse(textwrap.dedent(inspect.getsource(base)))
        except (OSError, TypeError):
            continue
        body = typing.cast(ast.ClassDef, tree.body[0]).body
        for first, second in zip(body, body[1:]):
            if (
                isinstance(first, ast.AnnAssign)
                and isinstance(first.target, ast.Name)
                and isinstance(second, ast.Expr)
                and isinstance(second.value, ast.Constant)
                and isinstance(second.value.value, str)
            ):
                docs[first.target.id] = " ".join(second.value.value.split())
    return docs
