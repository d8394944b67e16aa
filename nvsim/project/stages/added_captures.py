"""Adds another capture of the building to a project, whose capture becomes a list of captures.

The existing frames keep their numbers and poses, because the new trajectory is aligned to the project's frame.
Corrected masks stay with their frames. The later stages become outdated.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from nvsim.capture.excluded_frames import expand_list, names_in
from nvsim.capture.findings import Findings
from nvsim.capture.formats import read_raw
from nvsim.capture.multi_capture import SUFFIX, labels, listed_captures, write_list
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
    """The captures that `capture` was read from, usually one. Raises InputError if its list cannot be read."""
    return listed_captures(capture.source) if capture.source.suffix == SUFFIX else [capture.source.resolve()]


def run(project: Project, source: Path, listen: Listener, leave_out: str = "") -> Capture:
    """Imports the project's captures and `source`, which may be a list of captures, as one capture, and returns it.

    Frames named in `leave_out`, by their names in the combined capture, are skipped, and so are those that the first
    import skipped. Images are searched at their previous paths.

    Raises InputError if the project has no capture, already has this one, or the import refuses the result. The project
    is then unchanged.
    """
    former = project.need_capture()
    source = source.expanduser().resolve()
    if footage_at(source) is not None:
        raise InputError(
            f"{source} is a video, whose poses have their own frame and unit; put all videos of the building in one "
            "folder and import that folder into a new project."
        )
    held = sources(former)
    new = listed_captures(source) if source.suffix == SUFFIX else [source]
    for path in new:
        if any(path in (other, other.parent) or path.parent == other for other in held):
            raise InputError(f"{project.layout.root} already contains {path}; name another capture.")
    path = project.layout.root / f"together-{len(held) + len(new)}{SUFFIX}"
    carried: list[tuple[Path, Path]] = []
    try:
        write_list([*held, *new], path)
        _copy_corrections(project, former, labels(held)[0] if former.source.suffix != SUFFIX else "", carried)
        config = _left_out(project, former, labels(held)[0], leave_out)
        capture = imported.run(project, path, config, listen, former.alignment)
    except BaseException:  # also an interruption by the user
        if not _is_source(project, path):
            path.unlink(missing_ok=True)
            for _, copy in carried:
                copy.unlink(missing_ok=True)
        raise
    for old, _ in carried:
        old.unlink(missing_ok=True)
    if former.source.parent == project.layout.root and former.source.suffix == SUFFIX:
        former.source.unlink(missing_ok=True)
    return capture


def _is_source(project: Project, path: Path) -> bool:
    """Whether the project's capture was read from `path`."""
    try:
        capture = project.capture()
    except InputError:
        return False
    return capture is not None and capture.source == path


def _left_out(project: Project, former: Capture, label: str, more: str) -> CaptureConfig:
    """The options of the first import, with the names of skipped frames in the combined capture."""
    config = imported.capture_config(project)
    before, more = config.leave_out, expand_list(more)
    if before and former.source.suffix != SUFFIX:
        frames = frozenset(f.name for f in read_raw(former.source, Findings()).frames)
        before = ",".join(f"{label}/{name}" for name in sorted(names_in(before, frames)))
    # If the user has chosen a COLMAP model, the source is the folder of that model.
    return replace(config, leave_out=",".join(part for part in (before, more) if part), model="")


def _copy_corrections(project: Project, former: Capture, label: str, carried: list[tuple[Path, Path]]) -> None:
    """Copies corrections to the new names of their frames. Appends (old, copy) to `carried` before each copy."""
    if not label:
        return
    layout = project.layout
    for index in sorted(corrected_frames(layout, former.frames)):
        name = former.frames[index].name
        old, copy = layout.correction(name), layout.correction(f"{label}/{name}")
        carried.append((old, copy))
        write_bytes(copy, old.read_bytes())
