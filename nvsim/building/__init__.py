"""The built-in building: a procedural floor plan with furniture, light, trajectory, LiDAR scan, images, and ground
truth.

It does not depend on the capture readers: it writes an ordinary capture, which they read like any other.
"""

from __future__ import annotations

from pathlib import Path

from nvsim.building.config import BuildingConfig
from nvsim.events import Listener, ignore_event

__all__ = ["BuildingConfig", "generate"]


def generate(folder: Path, config: BuildingConfig, listen: Listener = ignore_event) -> None:
    """Writes `folder`/capture (nerfstudio) and `folder`/ground_truth; returns at once if this building already exists
    there. Deterministic in `config`. Raises InputError if a file cannot be written."""
    from nvsim.building.generation import generate as generate_now

    generate_now(folder, config, listen)
