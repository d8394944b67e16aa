"""The formats of captures, in one table, and the door that recognises them. A new reader is a file and a row here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from nvsim.capture import colmap, kapture, multi_capture, nerfstudio
from nvsim.capture.findings import Findings, shown
from nvsim.capture.masks import with_masks_beside
from nvsim.capture.raw import RawCapture, RawFrame
from nvsim.errors import InputError
from nvsim.files.reading import reading


def _complete(folder: Path) -> str:
    return ""


@dataclass(frozen=True)
class Format:
    """One way in which a capture lies on disk.

    name    for a list of names
    words   what it is, for a sentence: "a capture is ..."
    find    a folder, or a file of it -> what `read` takes, by the files alone; None where it is no such capture
    read    (what was found, findings) -> the capture. What is wrong but bearable goes to the findings; raises
            InputError when nothing can be read
    rather  name of the format that is read in its place where both lie there and this one brings no point cloud
    lacks   a folder in which no format was found -> a sentence about what it lacks of this one; "" where it does not
            look like it
    """

    name: str
    words: str
    find: Callable[[Path], Path | None]
    read: Callable[[Path, Findings], RawCapture]
    rather: str = ""
    lacks: Callable[[Path], str] = _complete


def _read_list(path: Path, findings: Findings) -> RawCapture:
    return multi_capture.read_several(path, read_raw, findings)


FORMATS: tuple[Format, ...] = (
    Format("kapture", "a kapture tree (sensors/sensors.txt)", kapture.find, kapture.read, lacks=kapture.lacks),
    Format(
        "nerfstudio transforms.json",
        "a transforms.json (nerfstudio, instant-ngp)",
        nerfstudio.find,
        nerfstudio.read,
        rather="COLMAP",  # they tell of the same walk, and the one that brings a cloud says more
    ),
    Format("a .captures list", "a file NAME.captures that lists several in one world", multi_capture.find, _read_list),
    Format("COLMAP", "a COLMAP model (cameras, images, points3D as .bin or .txt)", colmap.find, colmap.read),
)
"""In the order in which they are asked; the first that is found is read."""


def names() -> str:
    """The formats for a title: "A, B or C"."""
    return _listed([format.name for format in FORMATS])


def words() -> str:
    """The formats for a sentence: "a ..., a ... or a ..."."""
    return _listed([format.words for format in FORMATS])


def is_capture(path: Path) -> bool:
    """Whether a folder or a file is recognised as a capture, by the names of its files alone."""
    return any(format.find(path) is not None for format in FORMATS)


def read_raw(path: Path, findings: Findings) -> RawCapture:
    """The capture as its files say it. What is wrong goes to `findings`; raises InputError when nothing can be read."""
    path = Path(path)
    try:
        resolved = path.expanduser().resolve()
        exists, is_folder = resolved.exists(), resolved.is_dir()
        is_empty = is_folder and next(resolved.iterdir(), None) is None
    except (OSError, ValueError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else shown(error)
        raise InputError(f"{shown(path)} cannot be opened ({reason}); check the path.") from error
    if not exists:
        raise InputError(f"{shown(path)} does not exist; check the path.")
    if is_empty:
        raise InputError(f"{shown(path)} is an empty folder; a capture is {words()}.")
    with reading(path, "a capture"):
        return _settled(_read(resolved, findings), findings)


def _read(path: Path, findings: Findings) -> RawCapture:
    found = [(format, at) for format in FORMATS if (at := format.find(path)) is not None]
    if not found:
        raise _unknown(path)
    (first, at), *others = found
    for other, beside in others:
        if other.name == first.rather:
            return _richer(first, at, other, beside, path, findings)
    return first.read(at, findings)


def _richer(first: Format, at: Path, other: Format, beside: Path, folder: Path, findings: Findings) -> RawCapture:
    """The capture of `first` where it has a cloud, otherwise that of `other`."""
    own = Findings()
    raw = first.read(at, own)
    if raw.cloud is None:
        findings.note(
            f"{at.name} has no point cloud and {other.words} lies beside it",
            folder.name,
            f"that of {other.name} is read; name {at.name} to read it instead",
        )
        return other.read(beside, findings)
    for finding in own:
        findings.add(finding)
    return raw


def _unknown(path: Path) -> InputError:
    for format in FORMATS:
        if sentence := format.lacks(path):
            return InputError(sentence)
    if path.is_dir():
        return InputError(f"{shown(path)} holds no capture that is known; a capture is {words()}.")
    return InputError(f"{shown(path)} is not a capture; name the folder of {words()}.")


def _settled(raw: RawCapture, findings: Findings) -> RawCapture:
    """The capture with findings about the list of frames as a whole: none, names twice."""
    if not raw.frames:
        findings.error("the capture lists no frame", raw.source.name, "there is nothing to work on")
    seen: dict[str, RawFrame] = {}
    for frame in raw.frames:
        if frame.name in seen:
            findings.error(
                "the image is listed twice", f"{frame.where} and {seen[frame.name].where}", "its pose is ambiguous"
            )
        seen.setdefault(frame.name, frame)
    return with_masks_beside(raw)


def _listed(parts: list[str]) -> str:
    return " or ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
