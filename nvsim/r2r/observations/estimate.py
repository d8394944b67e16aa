"""How much an export of a scan writes and how long it takes, from its settings and from counts, before it begins.

The constants are fitted to exports of `nvsim demo --small` and of the hall of the tests: `python
tests/benchmarks/scan_sizes.py PROJECT` prints what is said beside what is written. All files together are meant to
hold within a factor of two, the time within a factor of three on x86-64 cores that have nothing else to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nvsim.geometry.view_sweep import VIEWS
from nvsim.graph.skybox_files import FOLDER
from nvsim.r2r.observations.settings import ScanSettings

# Bytes a pixel of strips as JPEG of quality 95 and of their depth as PNG, for faces of 512 pixels; with the side of a
# face they grow to the powers below, as finer pixels are more alike.
_STRIP, _STRIP_POWER = 0.25, -0.5
_DEPTH, _DEPTH_POWER = 0.90, -0.2
_VIEW = 0.17  # bytes a pixel of a view, which is 640 x 480
_QUALITIES = ((50, 75, 90, 95, 100), (0.32, 0.43, 0.69, 1.0, 2.4))  # size of a JPEG of a quality beside that of 95
_PLANS = 1.2  # bytes a pixel of a floor plan, the one with the graph included
_STUB, _STUB_VIEWS = 1_590_000, 290_000  # bytes
_ENTRY, _PAIR = 170, 12  # bytes of a viewpoint in a connectivity file, and of each pair of two
_HEAD, _LINE = 2_000, 185  # bytes of the manifest, and of each file in it
_OTHERS = 50  # bytes of scans.txt

# Processor seconds of a viewpoint with faces of 512 pixels, of a Gaussian in each, and of the 36 views of one.
_DRAW, _PER_GAUSSIAN, _VIEWS = 1.3, 1.5e-6, 0.7
_ALONE = 0.3  # share of them that one core does while others wait
_PLAN_PIXEL = 5e-7  # seconds
_START = 5.0  # seconds until the first viewpoint is drawn


@dataclass(frozen=True)
class Counts:
    """What there is of one scan.

    scan       its id
    viewpoints of its graph
    drawn      those of them that have images
    todo       those of these that are not finished in the folder
    plans      (width, height) of the floor plan of each storey, pixels
    gaussians  of the model that draws a viewpoint, mean over them
    """

    scan: str
    viewpoints: int
    drawn: int
    todo: int
    plans: tuple[tuple[int, int], ...]
    gaussians: float


@dataclass(frozen=True)
class Kind:
    """Files of one kind: what they are, the folder below that of the export, how many, bytes of all."""

    what: str
    folder: str
    files: int
    bytes: int


@dataclass(frozen=True)
class Estimate:
    """kinds    of files, those of all scans together
    drawn    viewpoints with images
    todo     those of them that are still to be drawn
    missing  bytes that are still to be written
    seconds  that it takes, None where that is not known
    """

    kinds: tuple[Kind, ...]
    drawn: int
    todo: int
    missing: int
    seconds: float | None

    @property
    def files(self) -> int:
        return sum(kind.files for kind in self.kinds)

    @property
    def bytes(self) -> int:
        """All of them, those that are there already included."""
        return sum(kind.bytes for kind in self.kinds)

    @property
    def sentence(self) -> str:
        """All of it in a line."""
        words = f"{self.drawn} viewpoints in {self.files} files, about {size_words(self.bytes)}"
        if self.todo < self.drawn:
            there = self.drawn - self.todo
            words += f"; {there} of the viewpoints {'is' if there == 1 else 'are'} there already"
        return f"{words}; takes {self.time}."

    @property
    def time(self) -> str:
        """What it takes, in words."""
        return "a time that is not known for gsplat" if self.seconds is None else time_words(self.seconds)

    def as_data(self) -> dict[str, Any]:
        """JSON-able."""
        return {**asdict(self), "files": self.files, "bytes": self.bytes, "sentence": self.sentence, "time": self.time}


def estimate(
    scans: Sequence[Counts], settings: ScanSettings, *, cores: int, on_card: bool = False, stub: str = ""
) -> Estimate:
    """The estimate for scans, one or the parts of a large graph, on so many `cores`, or drawn by a graphics card.
    `stub` is the id of the stub that will be written beside them, "" for none."""
    name = scans[0].scan if len(scans) == 1 else "SCAN"
    drawn, todo = (sum(getattr(scan, which) for scan in scans) for which in ("drawn", "todo"))
    each = _of_a_viewpoint(settings, name)
    kinds = [Kind(k.what, k.folder, k.files * drawn, k.bytes * drawn) for k in each]
    others = []
    if settings.plans:
        pixels = sum(w * h for scan in scans for w, h in scan.plans)
        count = sum(2 * len(scan.plans) + 1 for scan in scans)
        others.append(Kind("floor plans", f"floor_plans/{name}", count, round(_PLANS * pixels)))
    files = sum(k.files for k in each)
    graphs = sum(_ENTRY * s.viewpoints + _PAIR * s.viewpoints**2 for s in scans) + _OTHERS
    others.append(Kind("connectivity and scans.txt", "connectivity", len(scans) + 1, graphs))
    others.append(Kind("manifest", name, len(scans), _HEAD * len(scans) + _LINE * files * drawn))
    if len(scans) > 1:
        others.append(Kind("table of the parts", "", 1, 80 * sum(s.viewpoints for s in scans)))
    if stub:
        views = VIEWS if settings.views else 0
        others.append(Kind("stub for agents", stub, 3 + views, _STUB + (_STUB_VIEWS if views else 0)))
    missing = sum(k.bytes for k in each) * todo + sum(k.bytes for k in others)
    seconds = None if on_card else _START + sum(_seconds(s, settings, cores) for s in scans)
    return Estimate((*kinds, *others), drawn, todo, missing, seconds)


def _of_a_viewpoint(settings: ScanSettings, scan: str) -> list[Kind]:
    """Files and bytes of one viewpoint."""
    pixels, finer = 6 * settings.size**2, settings.size / 512
    quality = float(np.interp(settings.quality, *_QUALITIES))
    strip = round(_STRIP * finer**_STRIP_POWER * quality * pixels)
    kinds = [
        Kind("strips of six faces", f"{scan}/{FOLDER}", 1, strip),
        Kind("their depth", f"{scan}/{FOLDER}", 1, round(_DEPTH * finer**_DEPTH_POWER * pixels)),
    ]
    if settings.faces:
        kinds.append(Kind("single faces", f"{scan}/{FOLDER}", 6, strip))
    if settings.views:
        kinds.append(Kind("views", f"views/{scan}", VIEWS, round(VIEWS * _VIEW * quality * 640 * 480)))
    return kinds


def _seconds(scan: Counts, settings: ScanSettings, cores: int) -> float:
    pixels = (settings.size / 512) ** 2
    work = _DRAW * pixels + _PER_GAUSSIAN * scan.gaussians + (_VIEWS if settings.views else 0)
    plans = _PLAN_PIXEL * sum(w * h for w, h in scan.plans) if settings.plans else 0.0
    return scan.todo * work * (_ALONE + (1 - _ALONE) / max(1, cores)) + plans


def shortage(missing: int, free: int, place: object) -> str:
    """One sentence where the `free` bytes at `place` are too few, "" where they are enough."""
    if free >= missing:
        return ""
    return (
        f"About {size_words(missing)} are still to be written, but only {size_words(free)} are free at {place}; free "
        "some space, choose another folder, or ask for less."
    )


def size_words(count: float) -> str:
    """Bytes as "3 kB", "45 MB", "1.2 GB"."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 999.5 or unit == "GB":
            break
        count /= 1000
    return f"{count:.1f} {unit}" if count < 9.95 and unit == "GB" else f"{count:.0f} {unit}"


def time_words(seconds: float) -> str:
    """Roughly: "less than a minute", "about 3 minutes", "about 2 hours"."""
    if seconds < 50:
        return "less than a minute"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"about {minutes} minute{'' if minutes == 1 else 's'}"
    return f"about {round(seconds / 3600)} hours"
