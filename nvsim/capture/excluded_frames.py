"""Leave frames out of a capture by name: a list with commas, or a file with a name on each line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from nvsim.capture.findings import Findings
from nvsim.capture.raw import RawCapture
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import read_text

FROM_FILE = "@"
"""Prefix of an argument that names a file instead of a list."""
_LONGEST = 1 << 26  # bytes of such a file


def expand_list(text: str) -> str:
    """The list itself. For "@FILE" it is read from the lines of the file. Raises InputError if the file cannot be
    read."""
    if not text.startswith(FROM_FILE):
        return text
    path = Path(text[1:]).expanduser()
    then = "write the name of a frame on each line"
    lines = read_text(path, "a list of frames", then, _LONGEST).splitlines()
    return ",".join(line.strip() for line in lines if line.strip())


def write_names(names: Sequence[str], path: Path) -> None:
    """Write the names of frames in the format that `expand_list` reads.

    Raises InputError if the file cannot be written, or if a name does not fit on a line."""
    for name in names:
        if name != name.strip() or len(name.splitlines()) > 1:
            raise InputError(
                f"{name!r} cannot be written to a list of frames because of its spaces or line breaks; rename it."
            )
    atomic.write_text(path, "".join(f"{name}\n" for name in names))


def names_in(text: str, frames: frozenset[str]) -> frozenset[str]:
    """The names of `frames` that `text` lists, separated by commas. A name may contain commas.

    Raises InputError if a listed name is not in `frames`."""
    found, pieces = set(), text.split(",")
    most = 1 + max((name.count(",") for name in frames), default=0)  # pieces of a name
    at = 0
    while at < len(pieces):
        joined = {end: ",".join(pieces[at:end]).strip() for end in range(at + most, at, -1)}
        end = next((e for e, name in joined.items() if name in frames), None)
        if end is not None:
            found.add(joined[end])
        elif pieces[at].strip():
            example = f", such as {min(frames)}" if frames else ""
            raise InputError(
                f"--leave-out names {pieces[at].strip()!r}, which is not a frame of the capture; give names as it "
                f"lists them{example}."
            )
        at = at + 1 if end is None else end
    return frozenset(found)


def without_frames(raw: RawCapture, leave_out: str, findings: Findings) -> RawCapture:
    """`raw` without the frames that `leave_out` names, and `findings` without the findings about them.

    Raises InputError if a listed name is not a frame."""
    if not leave_out:
        return raw
    names = names_in(leave_out, frozenset(f.name for f in raw.frames))
    findings.remove_places(frozenset(f.where for f in raw.frames if f.name in names))
    depths = tuple(d for d in raw.depths if d.frame not in names)
    frames = tuple(f for f in raw.frames if f.name not in names)
    return replace(raw, frames=frames, depths=depths, left_out=raw.left_out | names)
