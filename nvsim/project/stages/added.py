"""Another capture of the same building: the project's capture becomes the list of those it held and the new
one.

What was imported keeps its place: the new walk is brought into the project's own frame, the frames that were there stay
first, and masks that a user corrected stay with their frames. The stages after the import notice that their input
has grown.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from nvsim.capture.findings import Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.left_out import names_in, written_out
from nvsim.capture.multi_capture import SUFFIX, labels, listed, write_list
from nvsim.capture.types import Capture
from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.files.atomic import write_bytes
from nvsim.project.config import CaptureConfig
from nvsim.project.corrections import corrected_frames
from nvsim.project.project import Project
from nvsim.project.stages import imported
from nvsim.reconstruction.footage_check import footage_at


def sources(capture: Capture) -> list[Path]:
    """The captures that `capture` was read from, one most often. Raises InputError when its list cannot be read."""
    return listed(capture.source) if capture.source.suffix == SUFFIX else [capture.source.resolve()]


def run(project: Project, source: Path, listen: Listener, leave_out: str = "") -> Capture:
    """Imports the project's captures and `source`, which may be a list itself, as one, without the frames that
    `leave_out` names as they will be called then, and without those that were left out before. Images are looked for
    where they were found before. Raises
    InputError when the project has no capture or holds this one already, and for what an import refuses; the
    project is then as before."""
    former = project.need_capture()
    source = source.expanduser().resolve()
    if footage_at(source) is not None:
        raise InputError(
            f"{source} is a video, whose poses have a frame and a unit of their own; put all videos of the building in "
            "one folder and import that folder into a new project."
        )
    held = sources(former)
    new = listed(source) if source.suffix == SUFFIX else [source]
    for path in new:
        if any(path in (other, other.parent) or path.parent == other for other in held):
            raise InputError(f"{project.layout.root} holds {path} already; name another capture.")
    path = project.layout.root / f"together-{len(held) + len(new)}{SUFFIX}"
    write_list([*held, *new], path)
    carried = _carry(project, former, labels(held)[0] if former.source.suffix != SUFFIX else "")
    try:
        config = _left_out(project, former, labels(held)[0], leave_out)
        capture = imported.run(project, path, config, listen, former.alignment)
    except InputError:
        path.unlink()
        for _, copy in carried:
            copy.unlink()
        raise
    for old, _ in carried:
        old.unlink(missing_ok=True)
    if former.source.parent == project.layout.root and former.source.suffix == SUFFIX:
        former.source.unlink(missing_ok=True)
    return capture


def _left_out(project: Project, former: Capture, label: str, more: str) -> CaptureConfig:
    """How the first capture was understood; what it left out is named after it from now on."""
    config = imported.capture_config(project)
    before, more = config.leave_out, written_out(more)
    if before and former.source.suffix != SUFFIX:
        frames = frozenset(f.name for f in read_raw(former.source, Findings()).frames)
        before = ",".join(f"{label}/{name}" for name in sorted(names_in(before, frames)))
    # The source of a capture of a chosen model is the folder of that model.
    return replace(config, leave_out=",".join(part for part in (before, more) if part), model="")


def _carry(project: Project, former: Capture, label: str) -> list[tuple[Path, Path]]:
    """Copies corrections to the names that their frames are about to have; returns (old, copy) of each."""
    if not label:
        return []
    layout, carried = project.layout, []
    for index in sorted(corrected_frames(layout, former.frames)):
        name = former.frames[index].name
        old, copy = layout.correction(name), layout.correction(f"{label}/{name}")
        write_bytes(copy, old.read_bytes())
        carried.append((old, copy))
    return carried
