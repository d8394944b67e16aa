"""Parse the YAML file of a ROS map (wiki.ros.org/map_server, section 2): its required keys and their valid values."""

from __future__ import annotations

import json
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import yaml

from nvsim.errors import InputError, value_text
from nvsim.files.opening import is_regular, read_bytes

# 0.196 keeps gray 205, whose occupancy is 0.19608, unknown.
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196
_LONGEST = 1 << 16  # bytes
_MOST_ENTRIES = 100_000  # of the folder in which an image is searched
_FINEST, _COARSEST, _FARTHEST = 1e-4, 1e3, 1e7  # meters
_PLAIN = re.compile(r"[A-Za-z0-9_./+-]+")
_YES, _NO = ("1", "true", "yes", "on"), ("0", "false", "no", "off", "")


@dataclass(frozen=True)
class Description:
    """image           the file, relative to the YAML file or absolute
    resolution      meters per cell
    origin          x and y in meters and yaw in radians, counter-clockwise, of the lower left corner of the image
    negate          whether white is occupied
    occupied, free  shares of black above and below which a cell is occupied or free
    raw             whether gray values are percent of occupancy
    """

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied: float
    free: float
    raw: bool


def description_text(path: Path) -> str:
    """The text of the YAML file. Raises InputError if it cannot be read or is not UTF-8."""
    try:
        return read_bytes(path, _LONGEST).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"Cannot read the map {path}: it is not text in UTF-8; name the .yaml file of a ROS map."
        ) from error


def quoted(name: str) -> str:
    """A file name as a YAML value; JSON quotes are valid in YAML."""
    return name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def parse_description(path: Path, text: str) -> Description:
    """The values in the `text` of the file `path`. Raises InputError with the line if the text is not YAML, a key is
    missing or given twice, or a value is invalid."""
    keys = _Keys(path, _root(path, text))
    image = keys.text("image", None)
    if not image or image in ("~", "null") or not image.isprintable() or len(image) > 500:
        raise keys.error("image", "names no file; write the name of the map's image there")
    resolution = keys.number("resolution", None)
    if not _FINEST <= resolution <= _COARSEST:
        raise keys.error("resolution", f"is {resolution}; it must be positive, in meters per cell")
    mode = keys.text("mode", "trinary").lower()
    if mode not in ("trinary", "scale", "raw"):
        raise keys.error("mode", f"{value_text(mode)!r} is unknown; write trinary, scale or raw")
    negate = keys.text("negate", "0").lower()
    if negate not in (*_YES, *_NO):
        raise keys.error("negate", f"is {value_text(negate)!r}; write 0 or 1")
    return Description(
        image,
        resolution,
        keys.origin(),
        negate in _YES,
        keys.share("occupied_thresh", OCCUPIED_THRESHOLD),
        keys.share("free_thresh", FREE_THRESHOLD),
        mode == "raw",
    )


def _root(path: Path, text: str) -> yaml.MappingNode:
    """The nodes of the text. They are never constructed as Python objects, so tags have no effect and an alias stays a
    reference. Numbers are converted later, because YAML 1.1 reads 1e-3 as text."""
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}, line {mark.line + 1}" if mark is not None else str(path)
        reason = getattr(error, "problem", None) or getattr(error, "reason", None) or "it cannot be parsed"
        raise InputError(
            f"{where}: this is not YAML ({value_text(reason)}); correct the line or export the map again."
        ) from error
    except RecursionError as error:
        raise InputError(f"{path} is nested too deeply for a ROS map; export the map again.") from error
    if isinstance(root, yaml.MappingNode):
        return root
    if root is None:
        raise InputError(f"{path} has no line 'image:'; add it (see the ROS map_server format).")
    raise InputError(f"{path}, line {root.start_mark.line + 1}: expected 'key: value', found {_short_value(root)!r}.")


class _Keys:
    """The values by key. Every error names the line of its value."""

    def __init__(self, path: Path, root: yaml.MappingNode) -> None:
        self._path = path
        self._nodes: dict[str, yaml.Node] = {}
        for key, value in root.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            where = f"{path}, line {key.start_mark.line + 1}"
            if name == "<<":
                raise InputError(f"{where}: merged keys (<<) are not read; write the keys out.")
            if name in self._nodes and _short_value(self._nodes[name]) != _short_value(value):
                raise InputError(
                    f"{where}: {value_text(name)} is given twice with other values; remove one of the lines."
                )
            self._nodes[name] = value

    def error(self, name: str, words: str) -> InputError:
        """The error about the value of a key."""
        node = self._nodes.get(name)
        line = "" if node is None else f", line {node.start_mark.line + 1}"
        return InputError(f"{self._path}{line}: {name} {words}.")

    def _required(self, name: str) -> yaml.Node:
        if name not in self._nodes:
            raise InputError(f"{self._path} has no line '{name}:'; add it (see the ROS map_server format).")
        return self._nodes[name]

    def text(self, name: str, default: str | None) -> str:
        if name not in self._nodes and default is not None:
            return default
        node = self._required(name)
        if not isinstance(node, yaml.ScalarNode):
            raise self.error(name, f"is {_short_value(node)}; it must be a single value")
        return str(node.value).rstrip("\n")  # a block value ends with line breaks

    def number(self, name: str, default: float | None) -> float:
        if name not in self._nodes and default is not None:
            return default
        return self._number(name, self._required(name))

    def share(self, name: str, default: float) -> float:
        value = self.number(name, default)
        if not 0 <= value <= 1:
            raise self.error(name, f"is {value}; it must be between 0 and 1")
        return value

    def origin(self) -> tuple[float, float, float]:
        node = self._required("origin")
        if not isinstance(node, yaml.SequenceNode) or len(node.value) not in (2, 3):
            raise self.error("origin", f"is {_short_value(node)}; it must be [x, y, yaw]")
        x, y, yaw = (*(self._number("origin", part) for part in node.value), 0.0)[:3]
        if max(abs(x), abs(y)) > _FARTHEST:
            raise self.error("origin", f"is {_short_value(node)}, more than {_FARTHEST:.0e} m away; write it in meters")
        return x, y, math.remainder(yaw, 2 * math.pi)

    def _number(self, name: str, node: yaml.Node) -> float:
        try:
            value = float(node.value) if isinstance(node, yaml.ScalarNode) else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            where = f"{self._path}, line {node.start_mark.line + 1}"
            raise InputError(f"{where}: {name} is {_short_value(node)}; it must be a number.")
        return value


def _short_value(node: yaml.Node) -> str:
    """A value for a message, shortened. Nested lists are shown as dots."""
    if isinstance(node, yaml.SequenceNode):
        parts = (value_text(n.value) if isinstance(n, yaml.ScalarNode) else "..." for n in node.value[:4])
        return f"[{', '.join(parts)}{', ...' if len(node.value) > 4 else ''}]"[:80]
    return repr(value_text(node.value)) if isinstance(node, yaml.ScalarNode) else "a table"


# The image ------------------------------------------------------------------------------------------------------


def find_image(path: Path, image: str) -> tuple[Path, str]:
    """The image that the YAML file `path` names, and a note for the user if the image is at another path, else "".

    Users move a map with its image, but map_saver writes absolute paths. If the path has no file, two folders are
    searched for the name: the relative folder of `image` below the YAML file, then the folder of the YAML file. Upper
    and lower case may differ. Windows paths are understood. If the search finds nothing, the result is the path itself.
    Raises InputError if several files differ from the name only in case.
    """
    named = path.parent / image
    if is_regular(named):
        return named, ""
    relative = PureWindowsPath(image)  # accepts both kinds of slashes
    places = [path.parent.joinpath(*relative.parent.parts), path.parent] if not relative.anchor else [path.parent]
    for folder in dict.fromkeys(places):
        found = (
            [folder / relative.name] if is_regular(folder / relative.name) else _ignoring_case(folder, relative.name)
        )
        if len(found) > 1:
            raise InputError(
                f"{path}: its image {value_text(image)} is not there, and {', '.join(p.name for p in found[:4])} "
                "beside it differ only in case; write the name of one of them in the line 'image:'."
            )
        if found:
            return found[0], f"{path}: its image {value_text(image)} is not there; {found[0]} is used."
    return named, ""


def _ignoring_case(folder: Path, name: str) -> list[Path]:
    try:
        with os.scandir(folder) as entries:
            names = [e.name for _, e in zip(range(_MOST_ENTRIES), entries) if e.name.casefold() == name.casefold()]
    except (OSError, ValueError):
        return []
    return [folder / each for each in sorted(names) if is_regular(folder / each)]
