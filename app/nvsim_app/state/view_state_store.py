"""The view state of a closed project as text in the settings, which the next window restores. Layers, comparison mode,
and panels apply to all projects and are stored elsewhere."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from nvsim.files.records import record_of
from nvsim_app.painting.cameras import ViewPose
from nvsim_app.painting.value_colors import CHANNELS
from nvsim_app.state.document import Selection

MOST_KEYS = 1000
FARTHEST = 1e7


@dataclass(frozen=True)
class StoredViewState:
    """The view state of a project.

    pose       pose of the 3D view's camera
    channel    channel of the 3D view
    selection  the selected object
    frame      frame whose page is shown instead of the 3D view
    map_range  x, y, width, height of the visible part of the map, meters
    panorama   heading and elevation of the center of the inspector's panorama in radians, and its zoom
    keys       key poses of the camera path
    """

    pose: ViewPose | None = None
    channel: str = "rgb"
    selection: Selection = Selection()
    frame: int | None = None
    map_range: tuple[float, float, float, float] | None = None
    panorama: tuple[float, float, float] | None = None
    keys: tuple[ViewPose, ...] = ()


def encode(left: StoredViewState) -> str:
    return json.dumps(asdict(left))


def decode(text: str) -> StoredViewState | None:
    """Parses the output of `encode`; None for any other text."""
    try:
        kept = json.loads(text)
        if not kept.keys() >= {"pose", "channel", "selection"}:
            return None
        left = record_of(StoredViewState, {**kept, "keys": kept.get("keys", [])[:MOST_KEYS]})
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None
    poses = [pose for pose in (left.pose, *left.keys) if pose is not None]
    values = [value for p in poses for value in (*p.position, p.heading, p.elevation, p.reach, p.fov)]
    if any(abs(value) > FARTHEST for value in (*values, *(left.map_range or ()), *(left.panorama or ()))):
        return None
    return left if left.channel in CHANNELS else None
