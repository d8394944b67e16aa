"""The report about the camera poses of a video, as a value and as the file `poses.json` beside the capture."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nvsim.errors import shown
from nvsim.files import atomic
from nvsim.files.reading import reading
from nvsim.files.regular import is_number, is_regular, read_json
from nvsim.footage.sources import Footage, Stamp

REPORT = "poses.json"
SETTINGS = 2
"""Counts up whenever the same video would give other frames or poses, so that older results are computed again."""
_LEAST = 8  # frames of a piece that has a model
_FEWEST = 0.5  # share of the chosen frames that must have a pose
_LARGEST = 1 << 24  # bytes of a report
_SHOWN = 8  # weak places in words
_ABOVE = 3  # folders above a model in which its report is searched


@dataclass(frozen=True)
class WeakPlace:
    """first, last  names of the chosen frames between which it is
    seconds      from and to, in the video of each of the two
    cause        in plain words
    advice       what to do when filming again
    """

    first: str
    last: str
    seconds: tuple[float, float]
    cause: str
    advice: str


@dataclass(frozen=True)
class PosesReport:
    """
    source       the video or the folder of videos, absolute
    footage      what it is in words: "a video", "3 videos"
    stamp        of its files
    settings     the version of NVSim's settings, `SETTINGS`
    looked_at    frames that were decoded
    frames       frames that were chosen; `blurred` of them are blurred, `with_pose` have a pose
    pieces       numbers of frames of all pieces that could not be joined, the largest first
    focal_px     focal length of each camera, pixels
    size_px      width and height of the frames, pixels
    residual_px  mean distance between points and where the frames show them, pixels
    loops        pairs of frames far apart in time that show the same place
    left_out     names of the chosen frames without a pose
    seconds      that the computation took
    views        images that each frame is; more than 1 for panoramas, whose frames are counted, not their views
    members      names of the frames of each piece, in the order of `pieces`; empty in reports of older versions
    upright      of each piece, whether z is up and its unit is the height of the cameras above the floor
    masked       percent of the pixels of the views of panoramas that a mask ignores
    mask         stamp of the mask that the user gave for panoramas, empty if the carrier was looked for
    weak         places where the frames do not hold together, in order of time
    """

    source: str
    footage: str
    stamp: Stamp
    settings: int
    looked_at: int
    frames: int
    blurred: int
    with_pose: int
    pieces: tuple[int, ...]
    focal_px: tuple[float, ...]
    size_px: tuple[int, int]
    residual_px: float
    loops: int
    left_out: tuple[str, ...]
    seconds: float
    views: int = 1
    members: tuple[tuple[str, ...], ...] = ()
    weak: tuple[WeakPlace, ...] = ()
    upright: tuple[bool, ...] = ()
    masked: float = 0.0
    mask: Stamp = ()

    @property
    def noun(self) -> str:
        """What the images are: "frames" of a video, or "photographs"."""
        return "photographs" if "photographs" in self.footage else "frames"

    def scale_for(self, camera_height: float | None, source: Path, model: str = "") -> float | None:
        """Meters per unit of a piece, by its `model` ("1" or "sparse/1") or else by the folder of the model at `source`
        (the largest if that is none), if its cameras are so many meters above the floor; None if the poses do not
        tell."""
        number = model.rpartition("/")[2] or source.name
        piece = int(number) if number.isdecimal() else 0
        return camera_height if piece < len(self.upright) and self.upright[piece] else None

    @property
    def usable(self) -> bool:
        """Whether enough of the frames have a pose."""
        return self.with_pose >= max(_FEWEST * self.frames, 1)

    @property
    def models(self) -> int:
        """How many pieces have a COLMAP model: sparse/0, which is the largest, sparse/1 and so on; of panoramas, the
        largest alone."""
        if self.views > 1:
            return int(self.usable)
        return max(sum(count >= _LEAST for count in self.pieces), int(self.usable))

    @property
    def refusal(self) -> str:
        """One sentence for a report that is not usable, with advice."""
        sizes = ", ".join(map(str, self.pieces[:6]))
        pieces = f" (separate pieces of {sizes} {self.noun})" if len(self.pieces) > 1 else ""
        numbers = " or ".join(f"--model {number}" for number in range(min(self.models, 6)))
        choice = f", or continue with one piece by {numbers}" if numbers else ""
        advice = (
            "take more of them, so that each shows much of what the one before shows, from a step aside"
            if self.noun == "photographs"
            else "film more slowly, walk through turns instead of turning on the spot, and keep furniture or other "
            "texture in view"
        )
        return (
            f"Only {self.with_pose} of {self.frames} {self.noun} of {self.source} have a common pose{pieces}; "
            f"{advice}{choice}."
        )


def stamp_of(footage: Footage) -> Stamp:
    """Raises OSError if a file is gone."""
    found = [(f.absolute(), f.stat()) for f in footage.files]
    return tuple((str(path), stat.st_size, stat.st_mtime_ns) for path, stat in found)


def write_report(report: PosesReport, folder: Path) -> None:
    """Writes `poses.json`. Raises InputError when the disk refuses."""
    atomic.write_text(folder / REPORT, json.dumps(asdict(report), indent=1))


def read_report(folder: Path) -> PosesReport | None:
    """The report in `folder`, None if there is none. Raises InputError if it is damaged."""
    path = folder / REPORT
    if not is_regular(path):
        return None
    data = read_json(path, "a report about poses", "remove it and compute the poses again", _LARGEST)
    with reading(path, "a report about poses", "remove it and compute the poses again"):
        return _parsed(data)


def report_beside(source: Path) -> PosesReport | None:
    """The report about the capture whose files are at `source`: in that folder or up to three above it; None if there
    is none. Raises InputError if it is damaged."""
    folder = folder_of_report(source)
    return None if folder is None else read_report(folder)


def folder_of_report(source: Path) -> Path | None:
    """The folder of the report about the capture whose files are at `source`; None if there is none."""
    return next((f for f in (source, *source.parents[:_ABOVE]) if is_regular(f / REPORT)), None)


def rows(report: PosesReport) -> dict[str, str]:
    """The report in plain words, each row by its name."""
    share = 100 * report.with_pose / max(report.frames, 1)
    kept = f"{report.with_pose:,} of {report.frames:,} ({share:.0f} %)"
    joined = f"all {report.noun} hold together"
    if len(report.pieces) > 1:
        others = ", ".join(f"{n:,}" for n in report.pieces[1:6]) + (", ..." if len(report.pieces) > 6 else "")
        joined = f"{len(report.pieces)}: the largest has {report.pieces[0]:,} {report.noun}, the others have {others}"
        if report.models > 1:
            joined += f"; --model 1 imports the second, up to --model {report.models - 1}"
    width, height = report.size_px
    focal = ", ".join(f"{f:.0f}" for f in report.focal_px)
    is_video = report.noun == "frames"
    found = {"Video" if is_video else "Photographs": report.source}
    if is_video:
        found["Decoded frames"] = f"{report.looked_at:,}"
    found[f"{report.noun.capitalize()} with a pose"] = kept
    if is_video:
        found["Blurred frames"] = f"{report.blurred:,} of the chosen frames" if report.blurred else "none"
    found["Pieces"] = joined
    found["Focal length"] = f"{focal} pixels at {width} x {height}"
    if is_video:
        found["Loops"] = f"{report.loops:,} pairs of frames show the same place again" if report.loops else _NO_LOOPS
    found |= {"Residual": f"{report.residual_px:.2f} pixels", "Time": f"{report.seconds:.0f} s"}
    if report.views > 1:
        images = f"{report.views * report.with_pose:,} images with a pose"
        found["Panoramas"] = f"each frame is {report.views} views: {images}"
        what = f"the mask {report.mask[0][0]}" if report.mask else "the carrier of the camera"
        found["Masked"] = f"{report.masked:.1f} % of the pixels of the views: {what}" if report.masked else "nothing"
    if report.left_out:
        names = ", ".join(report.left_out[:5]) + (", ..." if len(report.left_out) > 5 else "")
        without = f"{len(report.left_out):,}, too little in common with the others: {names}"
        found[f"{report.noun.capitalize()} without a pose"] = without
    for number, place in enumerate(report.weak[:_SHOWN], start=1):
        where = f"{_clock(place.seconds[0])} to {_clock(place.seconds[1])} ({place.first} to {place.last})"
        found[f"Weak place {number}"] = f"{where}: {place.cause}. When you film again: {place.advice}."
    if len(report.weak) > _SHOWN:
        found["More weak places"] = f"{len(report.weak) - _SHOWN:,}; poses.json lists them"
    return found


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


_NO_LOOPS = "none: the video never comes back to a place it showed before, so errors can add up"


# Any: JSON of a file that any program may have written.
def _parsed(data: Any) -> PosesReport:
    """Raises ValueError, KeyError or TypeError for anything but a report."""
    if not isinstance(data, Mapping):
        raise ValueError("it is no object")
    width, height = (_count(n) for n in data["size_px"])
    return PosesReport(
        source=_text(data["source"]),
        footage=_text(data["footage"]),
        stamp=_stamp(data["stamp"]),
        settings=_count(data["settings"]),
        looked_at=_count(data["looked_at"]),
        frames=_count(data["frames"]),
        blurred=_count(data["blurred"]),
        with_pose=_count(data["with_pose"]),
        pieces=tuple(_count(n) for n in data["pieces"]),
        focal_px=tuple(_figure(f) for f in data["focal_px"]),
        size_px=(width, height),
        residual_px=_figure(data["residual_px"]),
        loops=_count(data["loops"]),
        left_out=tuple(_text(name) for name in data["left_out"]),
        seconds=_figure(data["seconds"]),
        views=_count(data.get("views", 1)),
        members=tuple(tuple(_text(name) for name in names) for names in data.get("members", ())),
        weak=tuple(_place(place) for place in data.get("weak", ())),
        upright=tuple(value is True for value in data.get("upright", ())),
        masked=_figure(data.get("masked", 0.0)),
        mask=_stamp(data.get("mask", ())),
    )


def _stamp(data: Any) -> Stamp:
    return tuple((_text(path), _count(size), _count(changed)) for path, size, changed in data)


def _place(data: Any) -> WeakPlace:
    start, end = (_figure(s) for s in data["seconds"])
    first, last, cause, advice = (_text(data[name]) for name in ("first", "last", "cause", "advice"))
    return WeakPlace(first, last, (start, end), cause, advice)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{str(value)[:40]!r} is no text")
    return value


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value < 1 << 63:
        raise ValueError(f"{shown(value)} is no count")
    return value


def _figure(value: Any) -> float:
    if not is_number(value) or not 0 <= value < 1e15:
        raise ValueError(f"{shown(value)} is no figure")
    return float(value)
