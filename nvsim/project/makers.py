"""Who made a map: digests of a project's place and of a trajectory, which say nothing else of them."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

import numpy as np

from nvsim.capture.types import Capture

if TYPE_CHECKING:
    from nvsim.project.project import Project


def trajectory_digest(capture: Capture) -> str:
    """Of the names of the frames and their poses: the same for every import of the same frames in the same frame of
    reference."""
    state = hashlib.sha256(json.dumps([f.name for f in capture.frames]).encode())
    state.update(np.ascontiguousarray(np.round(capture.positions, 6) + 0.0).tobytes())
    return state.hexdigest()[:24]


def makers_of(capture: Capture, project: Project | None) -> tuple[str, ...]:
    """The digest of the trajectory, and of the project's folder where there is one."""
    if project is None:
        return (trajectory_digest(capture),)
    place = hashlib.sha256(str(project.layout.root.resolve()).encode(errors="surrogatepass")).hexdigest()[:24]
    return trajectory_digest(capture), place
