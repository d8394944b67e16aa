"""Several captures of one building as one: a text file that ends in .captures lists one capture per line.

All captures must share one world frame and one unit, like recordings that were registered together. This module does
not register them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from nvsim.capture.findings import Findings
from nvsim.capture.raw import RawCapture, lines_of
from nvsim.capture.types import Cloud
from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import read_bytes

SUFFIX = ".captures"
_LONGEST = 1_000_000  # bytes
_MOST = 100  # captures


def write_list(captures: Sequence[Path], path: Path) -> None:
    """Write a file that lists the captures and is a capture itself.

    Raises InputError if the file cannot be written, or if a path does not fit on a line."""
    lines = [str(Path(c).absolute()) for c in captures]
    for line in lines:
        if "#" in line or line != line.strip() or len(line.splitlines()) > 1:
            raise InputError(
                f"{line!r} cannot be written to a list of captures because of its #, spaces or line breaks; rename it."
            )
    atomic.write_bytes(path, b"".join(os.fsencode(f"{line}\n") for line in lines))


def listed_captures(path: Path) -> list[Path]:
    """The captures that the file lists. Relative paths start at its folder; text after # is a comment.

    Raises InputError if the file cannot be read, lists no capture, too many, one of them twice, or another list."""
    then = "write the path of a capture on each line"
    text = read_bytes(path, _LONGEST).decode("utf-8", "surrogateescape")  # file names may not be UTF-8
    found: list[Path] = []
    for number, line in lines_of(text):
        word = line.partition("#")[0].strip()
        if not word:
            continue
        try:
            found.append((path.parent / Path(word).expanduser()).resolve())
        except (OSError, ValueError, RuntimeError) as error:
            raise InputError(f"{path}, line {number}: {word[:80]!r} is not a valid path; {then}.") from error
    if not found:
        raise InputError(f"{path} names no capture; {then}.")
    if len(found) > _MOST:
        raise InputError(f"{path} names {len(found)} captures; at most {_MOST} are read together.")
    for i, capture in enumerate(found):
        if capture in found[:i]:
            raise InputError(f"{path} names {value_text(capture)} twice; remove one of the lines.")
        if capture.suffix == SUFFIX:
            raise InputError(
                f"{path} names {value_text(capture.name)}, which is itself a list; name its captures instead."
            )
    return found


def find(path: Path) -> Path | None:
    """The file itself if its name has the suffix of a list, otherwise None."""
    return path if path.suffix == SUFFIX and not path.is_dir() else None


def read_several(path: Path, read: Callable[[Path, Findings], RawCapture], findings: Findings) -> RawCapture:
    """The captures of the list as one capture; `read` reads one of them.

    Raises InputError if a capture cannot be read, or if the captures have different units."""
    sources = listed_captures(path)
    raws = [read(source, findings) for source in sources]
    if {True, False} <= {raw.metric for raw in raws}:  # None adopts the unit of the others, as they share one world
        units = ", ".join(f"{raw.source.name}: {'meters' if raw.metric else 'unknown'}" for raw in raws)
        raise InputError(f"The captures of {path} are not in one unit ({units}); transform them to one world first.")
    frames = [
        replace(frame, name=f"{label}/{frame.name}", where=f"{label}, {frame.where}", sensor=f"{label}/{frame.sensor}")
        for label, raw in zip(labels(sources), raws, strict=True)
        for frame in raw.frames
    ]
    clouds = [raw.cloud for raw in raws if raw.cloud is not None]
    formats = "+".join(dict.fromkeys(raw.format for raw in raws))
    scans = [
        replace(scan, sensor=f"{label}/{scan.sensor}")
        for label, raw in zip(labels(sources), raws, strict=True)
        for scan in raw.scans
    ]
    depths = [
        replace(depth, frame=depth.frame and f"{label}/{depth.frame}")
        for label, raw in zip(labels(sources), raws, strict=True)
        for depth in raw.depths
    ]
    telling = next((raw for raw in raws if raw.metric is not None), raws[0])
    unit = telling.metric, tuple(scans), tuple(depths), telling.metric_because
    return RawCapture(path, f"several ({formats})", tuple(frames), _join_clouds(clouds), *unit)


def labels(sources: Sequence[Path]) -> list[str]:
    """A short prefix for the frame names of each source: the name of its folder, numbered if it repeats. A capture
    that is appended to the list changes no other prefix."""
    found: list[str] = []
    for source in sources:
        name = (source if source.is_dir() else source.parent).name or "capture"
        others = (f"{name}-{number}" for number in range(1, len(sources) + 1))
        found.append(next(label for label in (name, *others) if label not in found))
    return found


def _join_clouds(clouds: Sequence[Cloud]) -> Cloud | None:
    """All points together. If some are from a scanner, only those, because the others are less accurate."""
    scanned = [c for c in clouds if c.kind == "lidar"]
    chosen = scanned or list(clouds)
    if not chosen:
        return None
    colors = [c.colors for c in chosen if c.colors is not None]
    together = np.concatenate(colors) if len(colors) == len(chosen) else None
    return Cloud(np.concatenate([c.points for c in chosen]), together, chosen[0].kind)
