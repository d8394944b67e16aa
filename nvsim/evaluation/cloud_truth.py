"""What a project's own scan says of its images for certain, as a truth where there is no other."""

from __future__ import annotations

from nvsim.errors import InputError
from nvsim.perception.cloud_labels import CloudLabels
from nvsim.project.project import Project


def labels_of(project: Project) -> CloudLabels:
    """Raises InputError for a project without a dense cloud."""
    cloud = project.scan()
    if cloud is None or not cloud.is_dense:
        raise InputError(f"{project.root} has no dense cloud that could label its images; choose another project.")
    return CloudLabels(cloud)
