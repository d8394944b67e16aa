"""Positions that phones and drones record beside images are read to the meter, and damaged files in one sentence."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from nvsim.errors import InputError
from nvsim.footage.extraction import VideoMoment
from nvsim.footage.position_logs import (
    GPS_ERROR,
    ar_positions,
    exif_position,
    gps_positions,
    local_meters,
    log_files,
    read_gpx,
    read_odometry,
    read_subtitles,
)
from nvsim.footage.sources import Footage, find_footage
from nvsim.reconstruction.footage_check import footage_at

HEADER = "timestamp, frame, x, y, z, qx, qy, qz, qw\n"
ROWS = "".join(f"{100 + k / 30}, {k:06d}, {k}.5, 1.4, {-2 * k}.0, 0, 0, 0, 1\n" for k in range(4))


def gpx(points: str, head: str = "") -> bytes:
    text = f'<?xml version="1.0"?>{head}<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1"><metadata>'
    return f"{text}<time>2001-01-01T00:00:00Z</time></metadata><trk><trkseg>{points}</trkseg></trk></gpx>".encode()


def point(latitude: object, longitude: object, time: str) -> str:
    return f'<trkpt lat="{latitude}" lon="{longitude}"><ele>5</ele><time>{time}</time></trkpt>'


def video(folder: Path, name: str = "walk.mp4") -> Footage:
    (folder / name).write_bytes(b"x")
    found = find_footage(folder / name)
    assert found is not None
    return found


def photograph(
    path: Path, latitude: float, longitude: float, error: float | None = None, sides: tuple[str, str] = ("N", "E")
) -> None:
    exif = Image.Exif()
    gps = exif.get_ifd(0x8825)
    for number, side, angle in ((1, sides[0], latitude), (3, sides[1], longitude)):
        minutes = (angle % 1) * 60
        gps[number] = side
        gps[number + 1] = (float(int(angle)), float(int(minutes)), round((minutes % 1) * 60, 5))
    if error is not None:
        gps[31] = error
    Image.new("RGB", (64, 48)).save(path, exif=exif)


# Readers --------------------------------------------------------------------------------------------------------------


def test_a_log_of_stray_scanner_is_turned_upright(tmp_path: Path) -> None:
    path = tmp_path / "odometry.csv"
    for header, more in ((HEADER, ""), (HEADER.replace("qw", "qw, fx, fy, distortion_center_x"), ", 1600, 1600, ")):
        path.write_text(header + ROWS.replace(", 1\n", f", 1{more}\n"))
        log = read_odometry(path)
        assert log.at.tolist() == [0, 1, 2, 3]
        assert log.places[2].tolist() == [2.5, 4.0, 1.4]  # y of ARKit is up, z points back


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "lacks the column frame"),
        (HEADER.encode(), "has no position"),
        (b"1, 2, 3\n", "lacks the column frame"),
        (HEADER.replace(" y,", "").encode() + ROWS.encode(), "lacks the column y"),
        ((HEADER + ROWS).encode()[:-30], "line 5"),
        ((HEADER + ROWS).replace("1.5", "nan").encode(), "line 3"),
        ((HEADER + ROWS).replace("1.5", "1e300").encode(), "line 3"),
        ((HEADER + ROWS).replace("000002", "-2").encode(), "line 4"),
        ((HEADER + ROWS).replace("1.5", "\x1b[31mred\x07").encode(), r"\x1b[31mred\x07"),
        ((HEADER + ROWS).replace("1.5", "\0").encode(), "odometry.csv"),
        ((HEADER + ROWS).encode("utf-16"), "not text in UTF-8"),
        ((HEADER + "9" * 200_000).encode(), "odometry.csv"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "odometry.csv"),
    ],
)
def test_a_damaged_log_is_one_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "odometry.csv"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_odometry(path)
    text = str(refused.value)
    assert said in text and text.isprintable() and len(text) < 1000


def test_a_gpx_track_has_seconds_and_degrees(tmp_path: Path) -> None:
    path = tmp_path / "walk.gpx"
    times = ("2026-05-01T10:00:00Z", "2026-05-01T12:00:01.5+02:00", "2026-05-01T10:00:03")
    points = "".join(point(48 + k / 1000, -11.5, time) for k, time in enumerate(times))
    path.write_bytes(gpx(points + '<trkpt lat="1" lon="2"/>'))  # the last has no time
    log = read_gpx(path)
    assert log.at.tolist() == [0, 1.5, 3]
    assert log.places == pytest.approx(np.array([[48, -11.5], [48.001, -11.5], [48.002, -11.5]]))


BOMB = '<!DOCTYPE gpx [<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9)
)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "no element found"),
        (gpx(""), "no track point with a time"),
        (gpx(point(1, 2, "now")), "now is not a time"),
        (gpx(point(1, 2, "2026-05-01T10:00:00Z" * 9)), "is not a time"),
        (gpx(point(91, 2, "2026-05-01T10:00:00Z")), "latitude 91"),
        (gpx(point("nan", 2, "2026-05-01T10:00:00Z")), "latitude nan"),
        (gpx(point("", 2, "2026-05-01T10:00:00Z")), "line 1"),
        (gpx(point(1, 2, "2026-05-01T10:00:00Z"))[:-30], "line 1"),
        (gpx(point(1, 2, "2026-05-01T10:00:00Z")).replace(b"<trk>", b"<trk>\x01"), "not well-formed"),
        (gpx(point(1, 2, "&j;"), BOMB + "]>"), "declares a document type"),
        (gpx(point(1, 2, "&x;"), '<!DOCTYPE gpx [<!ENTITY x SYSTEM "file:///etc/passwd">]>'), "declares a document"),
        (gpx(point(1, 2, "&x;")), "undefined entity"),
        (b"<html><body>404</body></html>", "walk.gpx"),
    ],
)
def test_a_damaged_gpx_track_is_one_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "walk.gpx"
    path.write_bytes(content)
    with pytest.raises(InputError) as refused:
        read_gpx(path)
    text = str(refused.value)
    assert said in text and "passwd" not in text and text.isprintable() and len(text) < 1000


def test_a_huge_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    for name, read in (("walk.gpx", read_gpx), ("odometry.csv", read_odometry), ("walk.srt", read_subtitles)):
        with open(tmp_path / name, "wb") as file:
            file.truncate(1 << 33)
        with pytest.raises(InputError, match="8589934592 bytes"):
            read(tmp_path / name)


def test_subtitles_of_drones_have_places_and_those_of_films_none(tmp_path: Path) -> None:
    path = tmp_path / "walk.SRT"
    cue = '{k}\n00:00:0{k},500 --> 00:00:0{k},533\n<font size="28">FrameCnt: {k}\n[iso : 100] '
    new = cue + "[latitude: 48.{k}] [longitude: -11.5] [rel_alt: 1.3 abs_alt: 132.8] </font>\n\n"
    old = cue + "[latitude : 48.{k}] [longtitude : -11.5] [altitude: 3.0]</font>\n\n"
    for form in (new, old):
        lost = form.replace("48.{k}", "0.000000").replace("-11.5", "0.000000")  # no position yet
        path.write_text(lost.format(k=0) + "".join(form.format(k=k) for k in range(1, 4)))
        log = read_subtitles(path)
        assert log.at.tolist() == [1.5, 2.5, 3.5]
        assert log.places == pytest.approx(np.array([[48.1, -11.5], [48.2, -11.5], [48.3, -11.5]]))
    path.write_text("1\n00:00:01,000 --> 00:00:02,000\nWhat latitude: is that?\n")
    assert not len(read_subtitles(path).at)
    path.write_text(new.format(k=1).replace("48.1", "481"))
    with pytest.raises(InputError, match="latitude 481"):
        read_subtitles(path)


def test_gps_of_photographs_is_read_with_its_error(tmp_path: Path) -> None:
    photograph(tmp_path / "a.jpg", 48.123456, 11.654321, 4.7)
    photograph(tmp_path / "b.jpg", 33.75, 70.25, sides=("S", "W"))
    found = exif_position(tmp_path / "a.jpg")
    assert found is not None and found == pytest.approx((48.123456, 11.654321, 4.7), abs=1e-6)
    assert exif_position(tmp_path / "b.jpg") == (-33.75, -70.25, None)
    Image.new("RGB", (64, 48)).save(tmp_path / "none.jpg")
    photograph(tmp_path / "far.jpg", 95, 11)
    photograph(tmp_path / "zero.jpg", 0, 0)
    photograph(tmp_path / "side.jpg", 48, 11, sides=("X", "E"))
    (tmp_path / "text.jpg").write_bytes(b"no image")
    (tmp_path / "cut.jpg").write_bytes((tmp_path / "a.jpg").read_bytes()[:120])
    for name in ("none", "far", "zero", "side", "text", "cut", "gone"):
        assert exif_position(tmp_path / f"{name}.jpg") is None, name


# From logs to images --------------------------------------------------------------------------------------------------


def test_degrees_become_meters_as_on_the_ellipsoid() -> None:
    # Independent: coordinates around the center of the earth (WGS 84), whose distances are those of straight lines.
    def around_center(degrees: np.ndarray) -> np.ndarray:
        latitude, longitude = np.radians(degrees).T
        squared = 0.00669437999014
        radius = 6_378_137.0 / np.sqrt(1 - squared * np.sin(latitude) ** 2)
        flat = radius * np.cos(latitude)
        return np.stack(
            [flat * np.cos(longitude), flat * np.sin(longitude), (1 - squared) * radius * np.sin(latitude)], axis=1
        )

    for middle in ((48.1, 11.5), (-33.9, 151.2), (0.0, 0.0), (64.0, 179.999)):
        degrees = np.array(middle) + np.array([[0, 0], [0.01, 0], [0, 0.01], [-0.01, -0.01], [0.005, -0.003]])
        degrees[:, 1] = (degrees[:, 1] + 180) % 360 - 180
        places, true = local_meters(degrees), around_center(degrees)
        found = np.linalg.norm(places[:, None] - places[None], axis=2)
        wanted = np.linalg.norm(true[:, None] - true[None], axis=2)
        assert found == pytest.approx(wanted, rel=1e-3)
    assert places[1, 1] > places[0, 1] and places[2, 0] > places[0, 0]
    assert np.isnan(local_meters(np.full((2, 2), np.nan))).all()


def test_frames_of_a_video_find_their_positions(tmp_path: Path) -> None:
    footage = video(tmp_path, "rgb.mp4")
    moments = {f"0_{k:06d}.jpg": VideoMoment(0, k, k / 30) for k in (0, 2, 3, 9)}
    assert ar_positions(footage, moments) is None and gps_positions(footage, moments) is None
    (tmp_path / "odometry.csv").write_text(HEADER + ROWS)
    known = ar_positions(footage, moments)
    assert known is not None and known.names == ("0_000000.jpg", "0_000002.jpg", "0_000003.jpg")  # 9 is not logged
    assert known.places[:, 1].tolist() == [0, 4, 6] and known.source == "the ARKit log odometry.csv"
    assert [path.name for path in log_files(footage)] == ["odometry.csv"]
    second = video(tmp_path, "other.mp4")
    assert [path.name for path in log_files(second)] == ["odometry.csv"]
    assert log_files(Footage(tmp_path, "video", (*footage.files, *second.files))) == ()


def test_a_track_must_begin_and_end_with_its_video(tmp_path: Path) -> None:
    footage = video(tmp_path)
    moments = {f"0_{k:06d}.jpg": VideoMoment(0, k, k / 10) for k in range(0, 600, 50)}
    track = "".join(point(48 + k / 1e5, 11, f"2026-05-01T10:{k // 60:02d}:{k % 60:02d}Z") for k in range(61))
    (tmp_path / "walk.gpx").write_bytes(gpx(track))
    known = gps_positions(footage, moments)
    assert known is not None and len(known.names) == 12 and known.error == GPS_ERROR
    speed = np.linalg.norm(np.diff(known.places, axis=0), axis=1) / 5
    assert speed == pytest.approx(np.full(11, 1.112), rel=0.01)  # meters of 1e-5 degrees
    late = "".join(point(48, 11, f"2026-05-01T10:{k:02d}:00Z") for k in range(10))
    (tmp_path / "walk.gpx").write_bytes(gpx(late))
    with pytest.raises(InputError, match="covers 540 s and its video about 55 s"):
        gps_positions(footage, moments)


def test_photographs_find_their_positions_by_the_names_of_the_stored_images(tmp_path: Path) -> None:
    for k, name in enumerate(("a.jpg", "b.jpg", "c.jpg")):
        photograph(tmp_path / name, 48 + k / 1000, 11, 4.0 + k)
    Image.new("RGB", (64, 48)).save(tmp_path / "d.jpg")
    footage = find_footage(tmp_path)
    assert footage is not None
    known = gps_positions(footage, {})
    assert known is not None and known.source == "GPS of 3 photographs" and known.error == 5.0
    places = dict(zip(known.names, known.places, strict=True))
    assert {"a.jpg", "a.png", "c.jpg"} <= set(places) and "d.jpg" not in places
    assert math.dist(places["a.jpg"], places["c.jpg"]) == pytest.approx(222.4, abs=0.2)


def test_a_folder_of_stray_scanner_is_a_video_with_a_log(tmp_path: Path) -> None:
    for name in ("depth/000000.png", "depth/000001.png", "depth/000002.png", "confidence/000000.png", "imu.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "rgb.mp4").write_bytes(b"x")
    (tmp_path / "camera_matrix.csv").write_text("1600, 0, 960\n0, 1600, 720\n0, 0, 1\n")
    (tmp_path / "odometry.csv").write_text(HEADER + ROWS)
    footage = footage_at(tmp_path)
    assert footage is not None and [path.name for path in footage.files] == ["rgb.mp4"]
    assert log_files(footage) == (tmp_path / "odometry.csv",)


@pytest.mark.parametrize("row", ["0,nan,1,2", "0,1,nan,2", "0,1,2,nan", "0,1,inf,2", "nan,1,2,3"])
def test_a_position_that_is_no_number_is_refused_in_every_column(tmp_path: Path, row: str) -> None:
    path = tmp_path / "odometry.csv"
    path.write_text(f"frame,x,y,z\n{row}\n")
    with pytest.raises(InputError, match="line 2"):
        read_odometry(path)
