"""The options of a command as a flat list of fields, and the conversion of changed values to command-line arguments.
Does not use Qt."""

from __future__ import annotations

import contextlib
import json
import re
import shlex
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from nvsim.cli.arguments import parse
from nvsim.cli.options import Option, command_of, options
from nvsim.errors import InputError
from nvsim.files.atomic import write_text
from nvsim.files.opening import parse_json, read_regular
from nvsim.project.jobs.files import is_order_proven, order_proof
from nvsim_app.look.plain_text import field_label

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


FILE = "settings.json"
PRESET = "preset"
PROOF = "proof"
"""Key beside the options of a command: proves that this user chose the paths here (see `nvsim.project.jobs.files`)."""
ELSEWHERE = ("cluster.executor", "cluster.address", "asked.endpoint", "asked.key_variable", "asking.yes")
"""Options that name other machines, or secrets sent to them. They are treated like paths outside the project."""
_WHAT = "settings"
_MOST = 4 << 20  # maximum size of the file, bytes


def arguments_of(fields: Sequence[Field], changed: Mapping[str, Any]) -> list[str]:
    """The flags that set the values of `changed` (path -> value). Values that equal the default are omitted."""
    words: list[str] = []
    for field in fields:
        if field.path not in changed or changed[field.path] == field.default:
            continue
        value = changed[field.path]
        if field.kind == "switch":
            words.append(field.flag if value else negated_flag(field.flag))
        elif field.kind == "several":
            words += [field.flag, *(str(v) for v in value)]
        else:
            words += [field.flag, "None" if value is None else _text(value)]
    return words


def negated_flag(flag: str) -> str:
    """--a.b.c -> --a.b.no-c"""
    head, dot, tail = flag.removeprefix("--").rpartition(".")
    return f"--{head}{dot}no-{tail}"


def _text(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def command_line(verb: str, arguments: Sequence[str]) -> str:
    """The command as text for a terminal."""
    return shlex.join(["nvsim", *verb.split(), *arguments])


class Settings:
    """The option values of each command that the user changed, stored in the project."""

    def __init__(self, project: Path | None) -> None:
        self._path = None if project is None else project / FILE
        self._values: dict[str, dict[str, Any]] = {}
        if self._path is not None:
            with contextlib.suppress(OSError, InputError, ValueError):
                read = parse_json(self._path, read_regular(self._path, _MOST).decode(), "a settings file", "")
                if isinstance(read, dict):
                    self._values = {v: dict(c) for v, c in read.items() if isinstance(c, dict)}

    def preset(self, verb: str) -> str:
        """The stored preset of a command; else its first preset, or "" if the command has no presets."""
        names = presets_of(verb)
        chosen = str(self._values.get(verb, {}).get(PRESET, ""))
        return chosen if chosen in names else (names[0] if names else "")

    def changed(self, verb: str) -> dict[str, Any]:
        """Path -> value of the options that differ from the preset.

        Values that no option accepts are omitted. Paths outside the project are omitted unless this user chose them
        here, because the project may come from another person."""
        stored = self._values.get(verb, {})
        fields = [f for f in fields_of(verb, self.preset(verb)) if f.path in stored]
        fitting = {f.path: _fitting(f, stored[f.path]) for f in fields}
        places = {f.path: str(v) for f in fields if _is_place(f) and isinstance(v := fitting[f.path], str | bool) and v}
        strange = {path for path, place in places.items() if not self._is_inside(path, place)}
        if strange and not self._is_proven(verb, places, stored.get(PROOF)):
            fitting = {path: value for path, value in fitting.items() if path not in strange}
        return {path: value for path, value in fitting.items() if value is not _UNFIT}

    def keep(self, verb: str, preset: str, changed: Mapping[str, Any]) -> None:
        """Stores the preset and the changed values of a command. Raises InputError if the project folder is not
        writable."""
        names = presets_of(verb)
        values: dict[str, Any] = {p: str(v) if isinstance(v, Path) else v for p, v in changed.items()}
        places = {f.path: str(values[f.path]) for f in fields_of(verb, preset) if _is_place(f) and values.get(f.path)}
        if self._path is not None and not all(self._is_inside(path, place) for path, place in places.items()):
            values[PROOF] = order_proof(self._path.parent, _WHAT, [verb, places])
        if names and preset != names[0]:
            values[PRESET] = preset
        if values:
            self._values[verb] = values
        else:
            self._values.pop(verb, None)
        if self._path is not None:
            write_text(self._path, json.dumps(self._values, indent=1, sort_keys=True) + "\n")

    def _is_inside(self, option: str, place: str) -> bool:
        if self._path is None or option in ELSEWHERE:
            return False
        return Path(place).expanduser().resolve().is_relative_to(self._path.parent.resolve())

    def _is_proven(self, verb: str, places: Mapping[str, str], proof: object) -> bool:
        return self._path is not None and is_order_proven(self._path.parent, _WHAT, [verb, dict(places)], proof)

    def arguments(self, verb: str) -> list[str]:
        """The flags of a command with the stored settings."""
        names, preset = presets_of(verb), self.preset(verb)
        head = ["--preset", preset] if names and preset != names[0] else []
        return [*head, *arguments_of(fields_of(verb, preset), self.changed(verb))]


def _is_place(field: Field) -> bool:
    return field.kind == "path" or field.path in ELSEWHERE


_UNFIT = object()
_LARGEST = 1e300
"""Larger numbers and NaN cannot be shown in a form."""


def _fitting(field: Field, value: Any) -> object:  # Any: unchecked JSON
    """The stored value converted to the field's type, or _UNFIT, because the file may contain any JSON."""
    if value is None:
        return None if field.optional else _UNFIT
    plain = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST
    if field.kind == "switch":
        return value if isinstance(value, bool) else _UNFIT
    if field.kind == "number":
        return float(value) if plain else _UNFIT
    if field.kind == "count":
        return int(value) if plain else _UNFIT
    if field.kind == "choice":
        return value if value in field.choices else _UNFIT
    if field.kind == "several":
        return tuple(value) if isinstance(value, list | tuple) else _UNFIT
    return value if isinstance(value, str) else _UNFIT


def validate(verb: str, project: Path, arguments: Sequence[str]) -> str:
    """One sentence if the command rejects these arguments, else ""."""
    try:
        parse(command_of(verb), ["--project", str(project), *arguments], verb)
    except InputError as error:
        return str(error)
    return ""
