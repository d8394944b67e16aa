"""What a project knows of surfaces, for robots that follow paths in it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from nvsim.project.project import Project


def cloud_of(project: Project) -> NDArray[np.floating] | None:
    """(N, 3) the points of its scan, or of the depth of its images, metres, world; None where it has neither, or a
    sparse one, which leaves out too much and holds too many points that are none."""
    cloud = project.scan() if project.capture is not None else None
    return None if cloud is None or not cloud.is_dense else cloud.points
