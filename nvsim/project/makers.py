"""Digests of a project's path and of a trajectory, which identify the origin of an occupancy map."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING

import numpy as np

from nvsim.capture.types import Capture

if TYPE_CHECKING:
    from nvsim.project.project import Project


def trajectory_digest(capture: Capture) -> str:
    """Hash of frame names and positions: equal for all imports of these frames with one alignment."""
    state = hashlib.sha256(json.dumps([f.name for f in capture.frames]).encode())
    state.update(np.ascontiguousarray(np.round(capture.positions, 6) + 0.0).tobytes())
    return state.hexdigest()[:24]


def makers_of(capture: Capture, project: Project | None) -> tuple[str, ...]:
    """The digest of the trajectory, and that of the project's folder if there is a project."""
    if project is None:
        return (trajectory_digest(capture),)
    place = hashlib.sha256(str(project.layout.root.resolve()).encode(errors="surrogatepass")).hexdigest()[:24]
    return trajectory_digest(capture), place
