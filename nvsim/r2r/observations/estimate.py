"""Estimates the size and duration of an export of a scan from its settings and counts, before it begins.

The constants are fitted to exports of `nvsim demo --small` and of the hall in the tests: `python
tests/benchmarks/scan_sizes.py PROJECT` prints the estimated and the written sizes. The total size should be right
within a factor of two, and the time within a factor of three on otherwise idle x86-64 cores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nvsim.geometry.directions import VIEWS
from nvsim.graph.skybox_files import FOLDER
from nvsim.r2r.observations.layout import ScanSettings

# Bytes per pixel of strips as JPEG of quality 95 and of their depth as PNG, for faces of 512 pixels. They scale with
# the side of a face to the powers below, because finer pixels are more similar.
_STRIP, _STRIP_POWER = 0.25, -0.5
_DEPTH, _DEPTH_POWER = 0.90, -0.2
_VIEW = 0.17  # bytes per pixel of a view, which is 640 x 480
_QUALITIES = ((50, 75, 90, 95, 100), (0.32, 0.43, 0.69, 1.0, 2.4))  # JPEG qualities, and sizes relative to quality 95
_MASK = 0.004  # bytes per pixel of a mask; viewpoints that are photographed all around have none
_PLANS = 1.2  # bytes per pixel of a floor plan, including the one with the graph
_STUB, _STUB_VIEWS = 1_590_000, 290_000  # bytes
_ENTRY, _PAIR = 170, 12  # bytes for each viewpoint in a connectivity file, and for each pair of viewpoints
_HEAD, _LINE = 2_000, 185  # bytes of the manifest, and of each file entry in it
_OTHERS = 50  # bytes of scans.txt

# CPU seconds of a viewpoint with faces of 512 pixels, of each Gaussian for a viewpoint, and of its 36 views.
_DRAW, _PER_GAUSSIAN, _VIEWS = 1.3, 1.5e-6, 0.7
_ALONE = 0.3  # serial share of the work, during which the other cores wait
_PLAN_PIXEL = 5e-7  # seconds
_START = 5.0  # seconds until the first viewpoint is drawn


@dataclass(frozen=True)
class ScanCounts:
    """The counts of one scan.

    scan       its id
    viewpoints of its graph
    drawn      number of viewpoints that have images
    todo       number of those whose images are not finished
    plans      (width, height) of the floor plan of each storey, pixels
    gaussians  of the model that draws a viewpoint, mean over the viewpoints
    masked     whether viewpoints get a mask of the pixels that no training image shows
    """

    scan: str
    viewpoints: int
    drawn: int
    todo: int
    plans: tuple[tuple[int, int], ...]
    gaussians: float
    masked: bool = False


@dataclass(frozen=True)
class FileKind:
    """Files of one kind: label, folder below that of the export, number, total bytes."""

    what: str
    folder: str
    files: int
    bytes: int


@dataclass(frozen=True)
class ExportEstimate:
    """The estimate of an export.

    kinds    kinds of files, of all scans together
    drawn    number of viewpoints with images
    todo     number of viewpoints that are still to be drawn
    missing  bytes that are still to be written
    seconds  duration, None if it cannot be estimated
    """

    kinds: tuple[FileKind, ...]
    drawn: int
    todo: int
    missing: int
    seconds: float | None

    @property
    def files(self) -> int:
        return sum(kind.files for kind in self.kinds)

    @property
    def bytes(self) -> int:
        """Bytes of all files, including those that already exist."""
        return sum(kind.bytes for kind in self.kinds)

    @property
    def sentence(self) -> str:
        """The whole estimate in one line."""
        words = f"{self.drawn} viewpoints in {self.files} files, about {size_words(self.bytes)}"
        if self.todo < self.drawn:
            there = self.drawn - self.todo
            words += f"; {there} of the viewpoints {'is' if there == 1 else 'are'} already exported"
        return f"{words}; takes {self.time}."

    @property
    def time(self) -> str:
        """The duration in words."""
        return "an unknown time with gsplat" if self.seconds is None else duration_text(self.seconds)

    def as_data(self) -> dict[str, Any]:
        """Returns the estimate as JSON-compatible data."""
        return {**asdict(self), "files": self.files, "bytes": self.bytes, "sentence": self.sentence, "time": self.time}


def estimate(
    scans: Sequence[ScanCounts], settings: ScanSettings, *, cores: int, on_card: bool = False, stub: str = ""
) -> ExportEstimate:
    """Estimates an export.

    scans    one scan, or the parts of a large graph
    cores    number of CPU cores that draw
    on_card  whether a graphics card draws
    stub     id of the stub scan that is written too, "" for none
    """
    name = scans[0].scan if len(scans) == 1 else "SCAN"
    drawn, todo = (sum(getattr(scan, which) for scan in scans) for which in ("drawn", "todo"))
    each = _of_a_viewpoint(settings, name)
    kinds = [FileKind(k.what, k.folder, k.files * drawn, k.bytes * drawn) for k in each]
    others = []
    if masked := sum(scan.drawn for scan in scans if scan.masked):
        others.append(
            FileKind("masks of unseen pixels", f"{name}/{FOLDER}", masked, round(_MASK * 6 * settings.size**2) * masked)
        )
    if settings.plans:
        pixels = sum(w * h for scan in scans for w, h in scan.plans)
        count = sum(2 * len(scan.plans) + 1 for scan in scans)
        others.append(FileKind("floor plans", f"floor_plans/{name}", count, round(_PLANS * pixels)))
    files = sum(k.files for k in each)
    graphs = sum(_ENTRY * s.viewpoints + _PAIR * s.viewpoints**2 for s in scans) + _OTHERS
    others.append(FileKind("connectivity and scans.txt", "connectivity", len(scans) + 1, graphs))
    others.append(FileKind("manifest", name, len(scans), _HEAD * len(scans) + _LINE * files * drawn))
    if len(scans) > 1:
        others.append(FileKind("table of the parts", "", 1, 80 * sum(s.viewpoints for s in scans)))
    if stub:
        views = VIEWS if settings.views else 0
        others.append(FileKind("stub for agents", stub, 3 + views, _STUB + (_STUB_VIEWS if views else 0)))
    missing = sum(k.bytes for k in each) * todo + sum(k.bytes for k in others)
    seconds = None if on_card else _START + sum(_seconds(s, settings, cores) for s in scans)
    return ExportEstimate((*kinds, *others), drawn, todo, missing, seconds)


def _of_a_viewpoint(settings: ScanSettings, scan: str) -> list[FileKind]:
    """Returns the files and bytes of one viewpoint."""
    pixels, finer = 6 * settings.size**2, settings.size / 512
    quality = float(np.interp(settings.quality, *_QUALITIES))
    strip = round(_STRIP * finer**_STRIP_POWER * quality * pixels)
    kinds = [
        FileKind("strips of six faces", f"{scan}/{FOLDER}", 1, strip),
        FileKind("depth strips", f"{scan}/{FOLDER}", 1, round(_DEPTH * finer**_DEPTH_POWER * pixels)),
    ]
    if settings.faces:
        kinds.append(FileKind("single faces", f"{scan}/{FOLDER}", 6, strip))
    if settings.views:
        kinds.append(FileKind("views", f"views/{scan}", VIEWS, round(VIEWS * _VIEW * quality * 640 * 480)))
    return kinds


def _seconds(scan: ScanCounts, settings: ScanSettings, cores: int) -> float:
    pixels = (settings.size / 512) ** 2
    work = _DRAW * pixels + _PER_GAUSSIAN * scan.gaussians + (_VIEWS if settings.views else 0)
    plans = _PLAN_PIXEL * sum(w * h for w, h in scan.plans) if settings.plans else 0.0
    return scan.todo * work * (_ALONE + (1 - _ALONE) / max(1, cores)) + plans


def shortage(missing: int, free: int, place: object) -> str:
    """Returns a warning if the `free` bytes at `place` are not enough, else ""."""
    if free >= missing:
        return ""
    return (
        f"About {size_words(missing)} are still to be written, but only {size_words(free)} are free at {place}; free "
        "some space, choose another folder, or export less."
    )


def size_words(count: float) -> str:
    """Formats bytes as "3 kB", "45 MB" or "1.2 GB"."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 999.5 or unit == "GB":
            break
        count /= 1000
    return f"{count:.1f} {unit}" if count < 9.95 and unit == "GB" else f"{count:.0f} {unit}"


def duration_text(seconds: float) -> str:
    """Formats a duration roughly: "less than a minute", "about 3 minutes", "about 2 hours"."""
    if seconds < 50:
        return "less than a minute"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"about {minutes} minute{'' if minutes == 1 else 's'}"
    return f"about {round(seconds / 3600)} hours"
