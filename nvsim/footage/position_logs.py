"""Camera positions that a phone or a drone recorded with its images, in meters.

- `odometry.csv` next to a video, from Stray Scanner (ARKit): columns frame, x, y, z; y is up.
  https://docs.strayrobots.io/apps/scanner/format.html
- GPX 1.1 next to a video, with the video's name: trkpt with lat, lon, and time. https://www.topografix.com/GPX/1/1
- SRT subtitles of DJI drones, next to a video, with its name: [latitude: 48.1] [longitude: 11.6] in each subtitle.
- GPS attributes of photos. Exif 2.32, table 15.

GPS altitudes are ignored, because their error is two to three times that of the horizontal position.
"""

from __future__ import annotations

import csv
import math
import re
import warnings
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError, value_text
from nvsim.files.opening import is_regular, opened, read_bytes, read_text
from nvsim.files.reading import reading
from nvsim.footage.sources import Footage

if TYPE_CHECKING:
    from nvsim.footage.extraction import VideoMoment  # decodes images, which the window must not wait for

ODOMETRY = "odometry.csv"
AR_ERROR, GPS_ERROR = 0.05, 5.0
"""Errors in meters of a position from ARKit, and from GPS without a stated error. For a phone's GPS under open sky, see
https://www.gps.gov/systems/gps/performance/accuracy"""
_LARGEST = 1 << 26  # bytes; subtitles for each frame of half an hour have 50 MB
_FARTHEST = 1e6  # meters
_MOST_GAP = 2.0  # frames, or seconds, from an image to the nearest position, at most
_LATE, _LATE_SHARE = 10.0, 0.1  # seconds, and share of the video, by which a GPX track may be longer
_EQUATOR, _FLATTENING = 6_378_137.0, 1 / 298.257223563  # of the ellipsoid WGS 84, meters
_GPS_TAGS, _LONGEST_TEXT = 0x8825, 64
_SUBTITLE = re.compile(
    r"(?P<h>\d{1,3}):(?P<m>\d\d):(?P<s>\d\d)[,.](?P<ms>\d{3})\s*-->"
    r"|\b(?P<name>latitude|longt?itude)\s*:\s*(?P<value>[-+]?\d{1,4}(?:\.\d{1,18})?)"
)


@dataclass(frozen=True, eq=False)
class PositionLog:
    """at      (N,) float64, ascending: frame numbers, or seconds
    places  (N, 3) float64, meters, z up; for GPS (N, 2) float64, latitude and longitude in degrees
    """

    at: NDArray[np.float64]
    places: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CameraPositions:
    """Recorded camera positions of images.

    source  name of the recording, for use in a sentence
    is_gps  whether only the horizontal position is used
    names   names of the N images
    places  (N, 3) float64, meters, z up
    error   error of a position, meters
    """

    source: str
    is_gps: bool
    names: tuple[str, ...]
    places: NDArray[np.float64]
    error: float


def log_files(footage: Footage) -> tuple[Path, ...]:
    """Position logs next to the videos, found by file name."""
    if footage.kind != "video":
        return ()
    videos = footage.files[:1] if footage.sides else footage.files
    beside = [videos[0].with_name(ODOMETRY)] if len(videos) == 1 else []
    beside += [file.with_suffix(end) for file in videos for end in (".gpx", ".GPX", ".srt", ".SRT")]
    unique = {path.resolve(): path for path in reversed(beside) if is_regular(path)}  # some disks ignore the case
    return tuple(reversed(unique.values()))


def ar_positions(footage: Footage, moments: Mapping[str, VideoMoment]) -> CameraPositions | None:
    """Positions from the ARKit log next to a single video. None if there is none. Raises InputError if it is
    damaged."""
    path = next((file for file in log_files(footage) if file.name == ODOMETRY), None)
    if path is None:
        return None
    log, names = read_odometry(path), tuple(moments)
    places = _places_at(log, np.array([moments[name].frame for name in names], np.float64))
    return _located_positions(f"the ARKit log {path.name}", False, names, places, AR_ERROR)


def gps_positions(footage: Footage, moments: Mapping[str, VideoMoment]) -> CameraPositions | None:
    """Positions from the GPS of photos, or from the tracks next to videos. None if there are none.

    `moments` are those of a video. Raises InputError if a file is damaged, or if a track does not match the duration of
    its video."""
    if footage.kind == "photographs":
        return _of_photographs(footage)
    names, tracks = tuple(moments), list[str]()
    clips = np.array([moments[name].clip for name in names], np.int64)
    seconds = np.array([moments[name].seconds for name in names], np.float64)
    degrees = np.full((len(names), 2), np.nan)
    for path in log_files(footage):
        if path.name == ODOMETRY:
            continue
        of_clip = clips == next(k for k, file in enumerate(footage.files) if file.stem == path.stem)
        log = read_log(path)
        if path.suffix.lower() == ".gpx":
            _refuse_other_times(path, log, float(np.max(seconds[of_clip], initial=0.0)))
        if len(log.at):  # files without positions are ordinary subtitles
            tracks.append(path.name)
            degrees[of_clip] = _places_at(log, seconds[of_clip])
    if not tracks:
        return None
    source = f"the GPS track {tracks[0]}" if len(tracks) == 1 else f"{len(tracks)} GPS tracks"
    return _located_positions(source, True, names, local_meters(degrees), GPS_ERROR)


def local_meters(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    """Converts latitudes and longitudes (N, 2) in degrees to meters (N, 3): east and north of the median, and 0.

    The result is exact to 0.1 % within 5 km, below 80 degrees of latitude. NaN stays NaN."""
    known = degrees[np.isfinite(degrees).all(axis=1)]
    if not len(known):
        return np.full((len(degrees), 3), np.nan)
    around = (degrees[:, 1] - known[0, 1] + 180) % 360 - 180  # continuous at the date line
    latitude = math.radians(float(np.median(known[:, 0])))
    squared = _FLATTENING * (2 - _FLATTENING)
    curved = 1 - squared * math.sin(latitude) ** 2
    north = math.radians(1) * _EQUATOR * (1 - squared) / curved**1.5
    east = math.radians(1) * _EQUATOR * math.cos(latitude) / math.sqrt(curved)
    places = np.column_stack([east * around, north * degrees[:, 0], np.zeros(len(degrees))])
    return np.asarray(places - np.nanmedian(places, axis=0))


# Readers --------------------------------------------------------------------------------------------------------------


def read_log(path: Path) -> PositionLog:
    """Reads a file found by `log_files`. Raises InputError if it is damaged."""
    if path.name == ODOMETRY:
        return read_odometry(path)
    return read_gpx(path) if path.suffix.lower() == ".gpx" else read_subtitles(path)


def read_odometry(path: Path) -> PositionLog:
    """Reads a CSV file with the columns frame, x, y, z (meters, y up). Other columns are ignored. Raises InputError
    with the number of the wrong line."""
    what, then = "a position log with the columns frame, x, y, z", "export the recording again"
    with reading(path, what, then):
        rows = csv.reader(read_text(path, what, then, _LARGEST).split("\n"), skipinitialspace=True)
        header = [name.strip().lower() for name in next(rows, [])]
        missing = [name for name in ("frame", "x", "y", "z") if name not in header]
        if missing:
            raise InputError(f"{path} is not {what}: it lacks the column {missing[0]}; {then}.")
        columns = [header.index(name) for name in ("frame", "x", "y", "z")]
        found: dict[float, tuple[float, float, float]] = {}
        for row in rows:
            if not "".join(row).strip():
                continue
            try:
                frame, x, y, z = (float(row[column]) for column in columns)
            except (IndexError, ValueError):
                frame = x = y = z = math.nan
            if not (0 <= frame < 1e9 and all(abs(value) < _FARTHEST for value in (x, y, z))):
                text = value_text(",".join(row), 60)
                raise InputError(f"{path}, line {rows.line_num}: {text} is not a position of a frame; {then}.")
            found[frame] = (x, -z, y)
        if not found:
            raise InputError(f"{path} is not {what}: it has no position; {then}.")
        return _log(list(found), list(found.values()), 3)


def read_gpx(path: Path) -> PositionLog:
    """Reads a GPX track as seconds since its first point, and degrees. Points without a time are skipped.

    Raises InputError for other XML, and for a document type declaration, because its entities could fill the memory."""
    what, then = "a GPX track with times", "export the track again"
    track = _Track(path)
    with reading(path, what, then):
        try:
            track.parser.Parse(read_bytes(path, _LARGEST), True)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise InputError(f"{path} is not {what}: line {error.lineno}, {reason}; {then}.") from error
        if not track.at:
            raise InputError(f"{path} is not {what}: it has no track point with a time; {then}.")
        log = _log(track.at, track.places, 2)
        return PositionLog(log.at - log.at[0], log.places)


class _Track:
    """Collects the points of a GPX file."""

    def __init__(self, path: Path) -> None:
        self.at, self.places = list[float](), list[tuple[float, float]]()
        self._path = path
        self._point: tuple[float, float] | None = None
        self._time: str | None = None
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._refuse_document_type
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text

    def _refuse_document_type(self, *_: object) -> None:
        where = f"line {self.parser.CurrentLineNumber}"
        raise InputError(f"{self._path} declares a document type ({where}), which GPX does not allow; export it again.")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        if name == "trkpt":
            where = f"{self._path}, line {self.parser.CurrentLineNumber}"
            self._point = _degrees(attributes.get("lat", ""), attributes.get("lon", ""), where)
        elif name == "time" and self._point is not None:
            self._time = ""

    def _text(self, text: str) -> None:
        if self._time is not None and len(self._time) < _LONGEST_TEXT:
            self._time += text

    def _end(self, tag: str) -> None:
        name = tag.rpartition(":")[2]
        if name == "time" and self._time is not None and self._point is not None:
            try:
                time = datetime.fromisoformat(self._time.strip())
                seconds = (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
            except (ValueError, OverflowError) as error:
                where = f"{self._path}, line {self.parser.CurrentLineNumber}"
                raise InputError(
                    f"{where}: {value_text(self._time, 40)} is not a time; export the track again."
                ) from error
            self.at.append(seconds)
            self.places.append(self._point)
            self._time = None
        elif name == "trkpt":
            self._point = self._time = None


def read_subtitles(path: Path) -> PositionLog:
    """Reads the subtitles of a DJI drone as seconds in the video, and degrees. Empty for other subtitles.

    Positions with latitude 0 and longitude 0 are skipped, because a drone writes them until its GPS has a fix. Raises
    InputError for a position outside the valid range."""
    what = "subtitles"
    with reading(path, what):
        at, places = list[float](), list[tuple[float, float]]()
        seconds, latitude = math.nan, ""
        for found in _SUBTITLE.finditer(read_text(path, what, "export them again", _LARGEST)):
            if found["h"]:
                seconds = 3600 * int(found["h"]) + 60 * int(found["m"]) + int(found["s"]) + int(found["ms"]) / 1000
                latitude = ""
            elif found["name"] == "latitude":
                latitude = found["value"]
            elif latitude and math.isfinite(seconds):
                place = _degrees(latitude, found["value"], str(path))
                if any(place):
                    at.append(seconds)
                    places.append(place)
                latitude = ""
        return _log(at, places, 2)


def exif_positions(footage: Footage) -> list[tuple[float, float, float | None] | None]:
    """GPS positions of all photos, as in `exif_position`. Raises InputError if they are HEIC and the library that reads
    HEIC is not installed."""
    from nvsim.footage.photographs import allow_heic

    allow_heic(footage)
    with ThreadPoolExecutor() as pool:
        return list(pool.map(exif_position, footage.files))


def exif_position(path: Path) -> tuple[float, float, float | None] | None:
    """Latitude and longitude of a photo in degrees, and their error in meters (None if unknown). None without usable
    GPS attributes. Pixels are not decoded."""
    from PIL import Image

    try:
        with warnings.catch_warnings(), opened(path) as file:
            warnings.simplefilter("ignore")
            with Image.open(BufferedReader(file)) as image:
                if image.format == "PNG":  # Pillow would decode the pixels to find Exif
                    return None
                tags: dict[int, Any] = image.getexif().get_ifd(_GPS_TAGS)
        latitude, longitude = _angle(tags[2], tags[1], "NS"), _angle(tags[4], tags[3], "EW")
        error = float(tags.get(31, math.nan))
    # Damaged files raise many kinds of errors in the decoders and in the Exif tables.
    except (OSError, ValueError, SyntaxError, TypeError, LookupError, ArithmeticError, MemoryError, EOFError):
        return None
    except (InputError, Image.DecompressionBombError):
        return None
    if not (abs(latitude) <= 90 and abs(longitude) <= 180) or (latitude == 0 and longitude == 0):
        return None
    return latitude, longitude, error if 0 < error < _FARTHEST else None


def _angle(parts: Any, side: Any, sides: str) -> float:
    """Degrees from degrees, minutes, and seconds; negative on the second of two `sides`."""
    degrees, minutes, seconds = (float(part) for part in parts)
    letter = (side.decode() if isinstance(side, bytes) else str(side)).strip("\0 ").upper()
    return (1 - 2 * sides.index(letter[:1] or "?")) * (degrees + minutes / 60 + seconds / 3600)


# From logs to images --------------------------------------------------------------------------------------------------


def _of_photographs(footage: Footage) -> CameraPositions | None:
    """GPS positions of photos. The names are those of the stored images: the file name without its suffix if it is
    unique, then .jpg or .png."""
    found = exif_positions(footage)
    stems = Counter(path.stem for path in footage.files)
    names, degrees, errors = list[str](), list[tuple[float, float]](), list[float]()
    for path, position in zip(footage.files, found, strict=True):
        if position is None:
            continue
        base = path.stem if stems[path.stem] == 1 else path.name
        names += [f"{base}.jpg", f"{base}.png"]
        degrees += [position[:2]] * 2
        errors += [] if position[2] is None else [position[2]]
    if not names:
        return None
    error = float(np.median(errors)) if errors else GPS_ERROR
    source = f"GPS of {len(names) // 2} photographs"
    return _located_positions(source, True, tuple(names), local_meters(np.array(degrees)), error)


def _located_positions(
    source: str, is_gps: bool, names: tuple[str, ...], places: NDArray[np.float64], error: float
) -> CameraPositions:
    """The positions without images that have none."""
    kept = np.flatnonzero(np.isfinite(places).all(axis=1))
    return CameraPositions(source, is_gps, tuple(names[k] for k in kept), places[kept], error)


def _places_at(log: PositionLog, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, D) positions, linear between log entries. NaN if the nearest entry is too far."""
    wanted = np.where(np.isfinite(at), at, -np.inf)
    after = np.clip(np.searchsorted(log.at, wanted), 0, len(log.at) - 1)
    gap = np.minimum(np.abs(log.at[after] - wanted), np.abs(log.at[np.maximum(after - 1, 0)] - wanted))
    columns = [np.interp(wanted, log.at, column) for column in log.places.T]
    return np.where((gap <= _MOST_GAP)[:, None], np.column_stack(columns), np.nan)


def _refuse_other_times(path: Path, log: PositionLog, last: float) -> None:
    """Raises InputError if a track does not match its video, whose last image is at `last` seconds."""
    length = float(log.at[-1])
    if not last - _MOST_GAP <= length <= last + max(_LATE, _LATE_SHARE * last):
        raise InputError(
            f"{path} covers {length:.0f} s and its video about {last:.0f} s, so it is unknown when the video began; "
            "export the part of the track that belongs to the video."
        )


def _degrees(latitude: str, longitude: str, where: str) -> tuple[float, float]:
    try:
        place = float(latitude), float(longitude)
    except ValueError:
        place = math.nan, math.nan
    if not (abs(place[0]) <= 90 and abs(place[1]) <= 180):
        text = f"latitude {value_text(latitude, 30)}, longitude {value_text(longitude, 30)}"
        raise InputError(f"{where}: {text} is not a position on Earth; export the track again.")
    return place


def _log(at: list[float], places: list[Any], width: int) -> PositionLog:
    """A log in the order of `at`; the first of equal entries is kept."""
    times, first = np.unique(np.array(at, np.float64), return_index=True)
    return PositionLog(times, np.array(places, np.float64).reshape(-1, width)[first])
