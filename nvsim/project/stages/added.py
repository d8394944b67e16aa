"""Another walk through the same building: the project's capture becomes the list of those it held and the new one.

What was imported keeps its place: the new walk is brought into the project's own frame, the frames that were there stay
first, and masks that a person corrected stay with their frames. The stages after the import notice that their input
has grown.
"""

from __future__ import annotations

from pathlib import Path

from nvsim.atomic import write_bytes
from nvsim.capture.several import SUFFIX, labels, listed, write_list
from nvsim.capture.types import Capture
from nvsim.errors import InputError
from nvsim.events import Listener
from nvsim.project.corrections import corrected_frames
from nvsim.project.project import Project
from nvsim.project.stages import imported


def sources(capture: Capture) -> list[Path]:
    """The captures that `capture` was read from, one most often. Raises InputError when its list cannot be read."""
    return listed(capture.source) if capture.source.suffix == SUFFIX else [capture.source.resolve()]


def run(project: Project, source: Path, listen: Listener) -> Capture:
    """Imports the project's captures and `source`, which may be a list itself, as one. Raises InputError when the
    project has no capture or holds this one already, and whatever an import refuses; the project is then as before."""
    former = project.need_capture()
    source = source.expanduser().resolve()
    held = sources(former)
    new = listed(source) if source.suffix == SUFFIX else [source]
    for path in new:
        if any(path in (other, other.parent) or path.parent == other for other in held):
            raise InputError(f"{project.layout.root} holds {path} already; name another capture.")
    path = project.layout.root / f"together-{len(held) + len(new)}{SUFFIX}"
    write_list([*held, *new], path)
    carried = _carry(project, former, labels(held)[0] if former.source.suffix != SUFFIX else "")
    try:
        capture = imported.run(project, path, imported.capture_config(project), listen, former.alignment)
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
