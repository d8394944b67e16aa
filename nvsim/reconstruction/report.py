"""The report on the camera poses of footage, as a value and as the file `poses.json` next to the capture."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path

from nvsim.capture.types import Alignment
from nvsim.files import atomic
from nvsim.files.opening import is_regular, read_json
from nvsim.files.reading import reading
from nvsim.files.records import Count, Figure, record_of
from nvsim.footage.sources import Footage, Stamp
from nvsim.geometry.rotation import smallest_rotation
from nvsim.poses.feature_comparison import FeatureComparison

REPORT = "poses.json"
FRAMES = "frames of a video"
"""`PosesReport.footage` of photographs that are consecutive frames of a video, whose times are unknown."""
SETTINGS = 11
"""Version of the settings. A change that alters frames or poses increases it, so that older results are recomputed."""
_LEAST = 8  # frames of a piece that has a model
_FEWEST = 0.5  # share of the chosen frames that must have a pose
_LARGEST = 1 << 24  # bytes of a report, at most
_BEGINNING, _LONGEST = re.compile(rb'\s*\{\s*"source"\s*:'), 100  # of a report, and bytes in which it is searched
_CONTRADICTION = 0.1  # relative difference of a given and a measured scale that is reported
_SHOWN = 8  # weak places that are described
_ABOVE = 3  # parent folders of a model in which its report is searched


@dataclass(frozen=True)
class WeakPlace:
    """first, last  names of the chosen frames at its ends
    seconds      times of its ends, each in the video of that frame
    cause        cause in plain words
    advice       what to do when filming again
    """

    first: str
    last: str
    seconds: tuple[Figure, Figure]
    cause: str
    advice: str


@dataclass(frozen=True)
class MeasuredScale:
    """The scale of a piece from positions that a phone or a drone recorded.

    source       name of the recording: "the ARKit log odometry.csv", "GPS of 35 photographs"
    refused      reason why there is no scale; "" if there is one
    scale        meters per unit of the poses, 0 if there is none
    uncertainty  standard deviation of the scale, percent
    positions    number of images with a position; `agreeing` of them fit the poses
    residual_m   root mean square distance from these positions to the cameras, meters
    up           (3,) unit vector in the frame of the poses; empty if it is unknown or if z is up
    """

    source: str
    refused: str
    scale: Figure = 0.0
    uncertainty: Figure = 0.0
    positions: Count = 0
    agreeing: Count = 0
    residual_m: Figure = 0.0
    up: tuple[float, ...] = ()

    def words(self, upright: bool) -> str:
        """The scale as one line. `upright`: the unit of the poses is the height of the cameras above the floor."""
        if self.refused:
            return f"none from {self.source}: {self.refused}"
        length = f"{self.scale:.3g} m"
        basis = f"the cameras are {length} above the floor" if upright else f"a unit of the poses is {length}"
        return (
            f"{basis}, from {self.source}, with a standard deviation of {self.uncertainty:.1f} %; {self.agreeing:,} of "
            f"{self.positions:,} positions agree, within {self.residual_m:.2g} m"
        )


@dataclass(frozen=True)
class PosesReport:
    """
    source       absolute path of the video, or of the folder of videos or photos
    footage      the footage in words: "a video", "3 videos"
    stamp        stamp of its files
    settings     version of NVSim's settings, `SETTINGS`
    looked_at    number of decoded frames
    frames       number of chosen frames; `blurred` of them are blurred, `with_pose` have a pose
    bridges      number of further frames of a video: they are blurred, connect others, and are not in the capture
    pieces       numbers of frames of all pieces that could not be joined, the largest first
    focal_px     focal length of each camera, pixels
    size_px      width and height of the frames, pixels
    residual_px  mean reprojection error, pixels
    loops        number of overlapping pairs of frames far apart in time
    left_out     names of the chosen frames without a pose
    seconds      duration of the computation
    views        number of images of each frame; more than 1 for panoramas, where `frames` counts panoramas, not views
    members      names of the frames of each piece, in the order of `pieces`; empty in reports of older versions
    upright      for each piece, whether z is up and its unit is the height of the cameras above the floor
    masked       percentage of the pixels that masks of panorama views or of people ignore
    mask         stamp of the mask that the user gave for panoramas, empty if the carrier was searched
    weak         places where the frames are not connected, in order of time
    measured     the scale of each piece with a model, from recorded positions; empty if none were recorded
    fisheye      angles of view of the fisheye lenses, degrees; their frames are stored as pinhole images
    networks     networks that the user selected: use ("features" or "people"), name, and digest of each
    compared     how the features of the network and SIFT compare, None without a network for features
    position_logs  stamp of the files next to the video that were searched for positions; None if none were searched
    """

    source: str
    footage: str
    stamp: Stamp
    settings: Count
    looked_at: Count
    frames: Count
    blurred: Count
    with_pose: Count
    pieces: tuple[Count, ...]
    focal_px: tuple[Figure, ...]
    size_px: tuple[Count, Count]
    residual_px: Figure
    loops: Count
    left_out: tuple[str, ...]
    seconds: Figure
    views: Count = 1
    members: tuple[tuple[str, ...], ...] = ()
    weak: tuple[WeakPlace, ...] = ()
    upright: tuple[bool, ...] = ()
    measured: tuple[MeasuredScale, ...] = ()
    position_logs: Stamp | None = None
    masked: Figure = 0.0
    mask: Stamp = ()
    bridges: Count = 0
    fisheye: tuple[Figure, ...] = ()
    networks: tuple[tuple[str, str, str], ...] = ()
    compared: FeatureComparison | None = None

    @property
    def image_noun(self) -> str:
        """The word for the images: "frames" of a video, or "photographs"."""
        return "photographs" if "photographs" in self.footage else "frames"

    def scale_for(self, camera_height: float | None, source: Path, model: str = "") -> float | None:
        """Meters per unit of a piece whose cameras are `camera_height` meters above the floor. None if the poses are
        not in camera heights.

        The piece is given by its `model` ("1" or "sparse/1"), or else by the model folder `source`. For other folders
        it is the largest piece."""
        return camera_height if self.is_upright(source, model) else None

    def is_upright(self, source: Path, model: str = "") -> bool:
        """Whether z is up in a piece and its unit is the camera height. The piece is given as for `scale_for`."""
        piece = _piece(source, model)
        return piece < len(self.upright) and self.upright[piece]

    def measured_for(self, source: Path, model: str = "") -> MeasuredScale | None:
        """The measured scale of a piece, given as for `scale_for`. None if no positions were recorded."""
        piece = _piece(source, model)
        return self.measured[piece] if piece < len(self.measured) else None

    def measured_options(self, source: Path, model: str = "") -> tuple[float | None, float | None, Alignment | None]:
        """Scale, camera height, and alignment for reading a piece if the user gives no scale. Values that the measured
        scale does not determine are None. The piece is given as for `scale_for`."""
        measured = self.measured_for(source, model)
        if measured is None or measured.refused:
            return None, None, None
        if self.is_upright(source, model):
            return None, measured.scale, None
        known = Alignment(smallest_rotation(measured.up, (0.0, 0.0, 1.0)), measured.scale) if measured.up else None
        return measured.scale, None, known

    def scale_contradiction(self, scale: float, source: Path, model: str = "") -> str:
        """A sentence if the user's `scale`, in meters per unit of the poses, differs by more than 10 % from the
        measured scale of a piece; "" otherwise."""
        measured = self.measured_for(source, model)
        if measured is None or measured.refused or abs(scale / measured.scale - 1) <= _CONTRADICTION:
            return ""
        upright = self.is_upright(source, model)
        what = "the cameras are {:.3g} m above the floor" if upright else "a unit of the poses is {:.3g} m"
        return (
            f"With your scale, {what.format(scale)}, but {measured.source} gives {measured.scale:.3g} m "
            f"({100 * abs(scale / measured.scale - 1):.0f} % apart); your scale is used, so check it or omit it."
        )

    @property
    def usable(self) -> bool:
        """Whether enough frames have a pose."""
        return self.with_pose >= max(_FEWEST * self.frames, 1)

    @property
    def models(self) -> int:
        """Number of pieces with a COLMAP model: sparse/0, which is the largest, sparse/1, and so on. Panoramas have a
        model of the largest piece only."""
        if self.views > 1:
            return int(self.usable)
        return max(sum(count >= _LEAST for count in self.pieces), int(self.usable))

    @property
    def refusal(self) -> str:
        """One sentence with advice, for a report that is not usable."""
        sizes = ", ".join(map(str, self.pieces[:6]))
        pieces = f" (separate pieces of {sizes} {self.image_noun})" if len(self.pieces) > 1 else ""
        numbers = " or ".join(f"--model {number}" for number in range(min(self.models, 6)))
        choice = f", or continue with one piece by {numbers}" if numbers else ""
        advice = (
            "take more photographs that overlap much, each one from a step to the side of the previous one"
            if self.image_noun == "photographs"
            else "film more slowly, walk through turns instead of turning on the spot, and keep furniture or other "
            "texture in view"
        )
        return (
            f"Only {self.with_pose} of {self.frames} {self.image_noun} of {self.source} have a common pose{pieces}; "
            f"{advice}{choice}."
        )


def _piece(source: Path, model: str) -> int:
    number = model.rpartition("/")[2] or source.name
    return int(number) if number.isdecimal() else 0


def stamp_of(footage: Footage) -> Stamp:
    """Stamp of the files of `footage`. Raises OSError if a file is missing."""
    found = [(f.absolute(), f.stat()) for f in footage.files]
    return tuple((str(path), stat.st_size, stat.st_mtime_ns) for path, stat in found)


def write_report(report: PosesReport, folder: Path) -> None:
    """Writes `poses.json`. Raises InputError if writing fails."""
    atomic.write_text(folder / REPORT, json.dumps(asdict(report), indent=1))


def read_report(folder: Path) -> PosesReport | None:
    """The report in `folder`, None if there is none. Raises InputError if it is damaged."""
    path = folder / REPORT
    if not _is_report(path):
        return None
    data = read_json(path, "a report about poses", "remove it and compute the poses again", _LARGEST)
    with reading(path, "a report about poses", "remove it and compute the poses again"):
        report = record_of(PosesReport, data)
        if any(one.up and not _is_direction(one.up) or not (one.refused or one.scale > 0) for one in report.measured):
            raise ValueError("a measured scale is 0, or its up is not a direction")
        return report


def _is_direction(up: tuple[float, ...]) -> bool:
    return len(up) == 3 and 0.9 < sum(value * value for value in up) < 1.1


def report_beside(source: Path) -> PosesReport | None:
    """The report on the capture at `source`, from that folder or up to three folders above it. None if there is none.
    Raises InputError if it is damaged."""
    folder = folder_of_report(source)
    return None if folder is None else read_report(folder)


def folder_of_report(source: Path) -> Path | None:
    """The folder of the report on the capture at `source`. None if there is none."""
    return next((f for f in (source, *source.parents[:_ABOVE]) if _is_report(f / REPORT)), None)


def _is_report(path: Path) -> bool:
    """Whether the file at `path` begins as `write_report` begins. Other programs write files of this name too."""
    if not is_regular(path):
        return False
    with reading(path, "a report about poses"), path.open("rb") as file:
        return _BEGINNING.match(file.read(_LONGEST)) is not None


def rows(report: PosesReport) -> dict[str, str]:
    """The report in plain words: name and text of each row."""
    share = 100 * report.with_pose / max(report.frames, 1)
    kept = f"{report.with_pose:,} of {report.frames:,} ({share:.0f} %)"
    joined = f"all {report.image_noun} are connected"
    if len(report.pieces) > 1:
        others = ", ".join(f"{n:,}" for n in report.pieces[1:6]) + (", ..." if len(report.pieces) > 6 else "")
        joined = f"{len(report.pieces)}: the largest has {report.pieces[0]:,} {report.image_noun}, "
        joined += f"the {'other has' if len(report.pieces) == 2 else 'others have'} {others}"
        if report.models > 1:
            joined += f"; --model 1{f' to {report.models - 1}' if report.models > 2 else ''} imports another piece"
    width, height = report.size_px
    focal = ", ".join(f"{f:.0f}" for f in report.focal_px)
    is_video = report.image_noun == "frames"
    is_folder = report.footage == FRAMES
    found = {"Folder of frames" if is_folder else "Video" if is_video else "Photographs": report.source}
    if is_video:
        found["Frames in the folder" if is_folder else "Decoded frames"] = f"{report.looked_at:,}"
    found[f"{report.image_noun.capitalize()} with a pose"] = kept
    if is_video:
        found["Blurred frames"] = f"{report.blurred:,} of the chosen frames" if report.blurred else "none"
        if report.bridges:
            found["Blurred frames"] += f"; {report.bridges:,} more connect others and are not in the capture"
    found["Pieces"] = joined
    found["Focal length"] = f"{focal} pixels at {width} x {height}"
    if report.fisheye:
        degrees = ", ".join(f"{angle:.0f}" for angle in report.fisheye)
        found["Fisheye lens"] = f"{degrees} degrees; the frames are stored without distortion"
    if is_video:
        found["Loops"] = f"{report.loops:,} pairs of frames show a place again" if report.loops else _NO_LOOPS
    found |= {"Residual": f"{report.residual_px:.2f} pixels", "Time": f"{report.seconds:.0f} s"}
    if report.compared is not None:
        found["Features"] = _comparison_text(report.compared)
    for use, name, _ in report.networks:
        if use == "people":
            found["People"] = f"{report.masked:.1f} % of the pixels are masked, by {name}"
    if report.views > 1:
        images = f"{report.views * report.with_pose:,} images with a pose"
        found["Panoramas"] = f"each frame is {report.views} views: {images}"
        what = f"the mask {report.mask[0][0]}" if report.mask else "the carrier of the camera"
        found["Masked"] = f"{report.masked:.1f} % of the pixels of the views: {what}" if report.masked else "nothing"
    if report.left_out:
        names = ", ".join(report.left_out[:5]) + (", ..." if len(report.left_out) > 5 else "")
        without = f"{len(report.left_out):,}, too little in common with the others: {names}"
        found[f"{report.image_noun.capitalize()} without a pose"] = without
    for number, measured in enumerate(report.measured[:_SHOWN]):
        upright = number < len(report.upright) and report.upright[number]
        found[f"Measured scale of piece {number}" if number else "Measured scale"] = measured.words(upright)
    for number, place in enumerate(report.weak[:_SHOWN], start=1):
        where = f"{place.first} to {place.last}"
        if report.footage != FRAMES:
            where = f"{_clock(place.seconds[0])} to {_clock(place.seconds[1])} ({where})"
        found[f"Weak place {number}"] = f"{where}: {place.cause}. When you film again: {place.advice}."
    if len(report.weak) > _SHOWN:
        found["More weak places"] = f"{len(report.weak) - _SHOWN:,}; poses.json lists them"
    return found


def _comparison_text(compared: FeatureComparison) -> str:
    def figures(k: int) -> str:
        return (
            f"{compared.matches[k]:.0f} verified matches per pair, {100 * compared.verified[k]:.0f} % of pairs verified"
        )

    used = compared.network if compared.is_network_used else "SIFT"
    return f"{used} is used: on {compared.pairs} pairs, {compared.network} has {figures(0)}; SIFT has {figures(1)}"


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


_NO_LOOPS = "none: the video never returns to an earlier place, so errors can accumulate"
