"""The point cloud that keeps simulated robots away from obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from nvsim.project.project import Project


def dense_point_cloud(project: Project) -> NDArray[np.floating] | None:
    """(N, 3) meters, world: the LiDAR scan of a project or the dense point cloud from the depth of its images. None if
    the project has neither. A sparse cloud also gives None, because it has gaps and many false points."""
    cloud = project.scan() if project.capture() is not None else None
    return None if cloud is None or not cloud.is_dense else cloud.points
