"""Selects the sources of scans and images for a simulator's settings."""

from __future__ import annotations

from nvsim.r2r.simulator.images import Images, StripImages
from nvsim.r2r.simulator.nav_graph import NavGraph, Scans
from nvsim.r2r.simulator.settings import Settings


def source_of(settings: Settings) -> tuple[Scans, Images]:
    """Returns the scans and the images that the settings name. Raises InvalidValue if a project is unreadable."""
    folder = settings.nav_graph_path
    if (settings.dataset_path / "project.db").is_file():
        from nvsim.r2r.simulator.live import ProjectImages

        images = ProjectImages(settings.dataset_path, settings.rendering_enabled)
        return (images.scans() if folder is None else NavGraph(folder)), images
    return NavGraph(folder or "./connectivity"), StripImages(settings.dataset_path, settings.cache_size)
