"""Several captures of one building as one: a text file that ends in .captures and names a capture on each line.

They must share one world and one unit, as walks that were registered together do; nothing here registers them.
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
from nvsim.errors import InputError, shown
from nvsim.files import atomic
from nvsim.files.regular import read_bytes

SUFFIX = ".captures"
_LONGEST = 1_000_000  # bytes
_MOST = 100  # captures


def write_list(captures: Sequence[Path], path: Path) -> None:
    """Names the captures in a file that is a capture itself. Raises InputError when the disk refuses, or when a path
    cannot stand on a line."""
    lines = [str(Path(c).absolute()) for c in captures]
    for line in lines:
        if "#" in line or line != line.strip() or len(line.splitlines()) > 1:
            raise InputError(
                f"{line!r} cannot stand in a list of captures because of its #, spaces or line ends; rename it."
            )
    atomic.write_bytes(path, b"".join(os.fsencode(f"{line}\n") for line in lines))


def listed(path: Path) -> list[Path]:
    """The captures that the file names, relative ones from its folder; lines after # are remarks. Raises InputError
    when it cannot be read or names none, or one twice."""
    then = "write the path of a capture on each line"
    text = read_bytes(path, _LONGEST).decode("utf-8", "surrogateescape")  # names of files need not be UTF-8
    found: list[Path] = []
    for number, line in lines_of(text):
        word = line.partition("#")[0].strip()
        if not word:
            continue
        try:
            found.append((path.parent / Path(word).expanduser()).resolve())
        except (OSError, ValueError, RuntimeError) as error:
            raise InputError(f"{path}, line {number}: {word[:80]!r} cannot be a path; {then}.") from error
    if not found:
        raise InputError(f"{path} names no capture; {then}.")
    if len(found) > _MOST:
        raise InputError(f"{path} names {len(found)} captures; at most {_MOST} are read together.")
    for i, capture in enumerate(found):
        if capture in found[:i]:
            raise InputError(f"{path} names {shown(capture)} twice; remove one of the lines.")
        if capture.suffix == SUFFIX:
            raise InputError(f"{path} names {shown(capture.name)}, which is a list as well; name its captures here.")
    return found


def find(path: Path) -> Path | None:
    """The file itself, by the end of its name."""
    return path if path.suffix == SUFFIX and not path.is_dir() else None


def read_several(path: Path, read: Callable[[Path, Findings], RawCapture], findings: Findings) -> RawCapture:
    """The captures of the list as one. `read` reads one of them. Raises InputError when one cannot be read or they
    contradict each other about the unit."""
    sources = listed(path)
    raws = [read(source, findings) for source in sources]
    if {True, False} <= {raw.metric for raw in raws}:  # None is in the unit of the others, as it shares their world
        units = ", ".join(f"{raw.source.name}: {'metres' if raw.metric else 'unknown'}" for raw in raws)
        raise InputError(f"The captures of {path} are not in one unit ({units}); bring them into one world first.")
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
    return RawCapture(path, f"several ({formats})", tuple(frames), _joined(clouds), *unit)


def labels(sources: Sequence[Path]) -> list[str]:
    """A short name for each, which its frames begin with: its folder's, numbered where another had it before. A capture
    that is added at the end changes none of the others."""
    found: list[str] = []
    for source in sources:
        name = (source if source.is_dir() else source.parent).name or "capture"
        others = (f"{name}-{number}" for number in range(1, len(sources) + 1))
        found.append(next(label for label in (name, *others) if label not in found))
    return found


def _joined(clouds: Sequence[Cloud]) -> Cloud | None:
    """All points; where some are of a scanner, theirs alone, as the others are placed less well."""
    scanned = [c for c in clouds if c.kind == "lidar"]
    chosen = scanned or list(clouds)
    if not chosen:
        return None
    colors = [c.colors for c in chosen if c.colors is not None]
    together = np.concatenate(colors) if len(colors) == len(chosen) else None
    return Cloud(np.concatenate([c.points for c in chosen]), together, chosen[0].kind)
