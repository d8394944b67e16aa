"""The options of a command as a flat list of fields, read from its Arguments dataclass. Does not use Qt."""

from __future__ import annotations

import re
import types
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from app.look.wording import field_label
from nvsim.cli.options import Option, command_of, options

# Options that the window sets, that the form shows separately, or that do not start a job.
LEFT_OUT = ("project", "json", "dry_run", "capture", "preset", "config.name")
Kind = Literal["number", "count", "switch", "choice", "path", "text", "several"]


@dataclass(frozen=True)
class Field:
    """One option of a command.

    path      dotted, as in the dataclass: "config.loss.ssim"
    flag      as on the command line: "--loss.ssim"
    section   heading in the form, "" for options of the command itself
    optional  whether the value may be None
    choices   the allowed values of a "choice", or of a "several" with fixed values
    item      the type of one value of a "several"
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


def presets_of(verb: str) -> tuple[str, ...]:
    """The values of --preset; () if the command does not have this option."""
    hints = typing.get_type_hints(command_of(verb))
    return typing.get_args(hints["preset"]) if "preset" in hints else ()


def fields_of(verb: str, preset: str = "") -> list[Field]:
    """All options of a command, with the defaults of `preset`."""
    command = command_of(verb)
    hints = typing.get_type_hints(command)
    base = None
    if hasattr(command, "defaults"):
        base = command.defaults(["--preset", preset] if preset else [])
    found = [_field(option) for option in options(command, base) if option.flag]
    known = [f for f in found if f.path not in LEFT_OUT]
    return [f for f in known if f.path.partition(".")[0] in hints]


def paper_values(verb: str) -> dict[str, Any]:
    """Path -> the paper's value of each option, from the preset that represents the paper; empty if there is none."""
    names = presets_of(verb)
    paper = next((n for n in ("paper", "splatfacto-i") if n in names), None)
    return {} if paper is None else {f.path: f.default for f in fields_of(verb, paper)}


def _field(option: Option) -> Field:
    hint, name = option.hint, option.path.rpartition(".")[2]
    optional = False
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        inner = [a for a in typing.get_args(hint) if a is not type(None)]
        optional, hint = len(inner) < len(typing.get_args(hint)), inner[0]
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
    flag = "--" + ".".join([*option.groups, name.rstrip("_")]).replace("_", "-")
    unit = unit_of(name, option.help, kind)
    section = ": ".join(map(field_label, option.groups))
    return Field(
        option.path, flag, field_label(name), section, kind, option.default, option.help, unit, optional, choices, item
    )


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


_UNITS = (
    (r"^Met(re|er)s per unit", "m per unit"),
    (r"(?i)(^|: |\b(in|of) |, )met(re|er)s\b|\bmet(re|er)s[:;.]", "m"),
    (r"^Degrees\b|\bin degrees\b", "°"),
    (r"\bpixels\.|^Pixels\b", "px"),
    (r"^GiB\b", "GiB"),
    (r"^(Least time|Seconds)\b|\bseconds[.;]", "s"),
)
