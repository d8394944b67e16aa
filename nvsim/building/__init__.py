"""The built-in building: a procedural floor plan, furnished, lit, walked through, scanned and rendered, with its truth.

Knows nothing of readers: what it writes is an ordinary capture and is read as one.
"""

from __future__ import annotations

from pathlib import Path

from nvsim.building.config import BuildingConfig
from nvsim.events import Listener, silent

__all__ = ["BuildingConfig", "generate"]


def generate(folder: Path, config: BuildingConfig, listen: Listener = silent) -> None:
    """Writes `folder`/capture (nerfstudio) and `folder`/ground_truth; returns at once where the same building is
    already there. Deterministic in `config`. Raises InputError when the disk refuses."""
    from nvsim.building.generation import generate as generate_now

    generate_now(folder, config, listen)
