"""Ground truth from a project's own dense point cloud, for projects without other ground truth."""

from __future__ import annotations

from nvsim.errors import InputError
from nvsim.perception.cloud_labels import CloudLabels
from nvsim.project.project import Project


def labels_of(project: Project) -> CloudLabels:
    """The labels that the project's cloud gives to images. Raises InputError if the project has no dense cloud."""
    cloud = project.scan()
    if cloud is None or not cloud.is_dense:
        raise InputError(f"{project.root} has no dense point cloud to label its images; choose another project.")
    return CloudLabels(cloud)
