"""The view state of a closed project as text in the settings, which the next window restores. Layers, comparison mode,
and panels apply to all projects and are stored elsewhere."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

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
        chosen = kept["selection"]
        selection = Selection(
            *(_optional(chosen[name], kind) for name, kind in (("viewpoint", str), ("frame", int), ("submap", int)))
        )
        pose, view, panorama = kept["pose"], kept.get("map_range"), kept.get("panorama")
        left = StoredViewState(
            None if pose is None else _pose(pose),
            str(kept["channel"]),
            selection,
            _optional(kept.get("frame"), int),
            None if view is None else _numbers(view, 4),  # type: ignore[arg-type]
            None if panorama is None else _numbers(panorama, 3),  # type: ignore[arg-type]
            tuple(_pose(key) for key in kept.get("keys", [])[:MOST_KEYS]),
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None
    return left if left.channel in CHANNELS else None


# Any, here and below: unchecked JSON, which is parsed or refused.
def _optional(value: Any, kind: type) -> Any:
    if value is not None and type(value) is not kind:
        raise ValueError(value)
    return value


def _numbers(values: Any, count: int) -> tuple[float, ...]:
    if len(values) != count:
        raise ValueError(values)
    return tuple(_number(v) for v in values)


def _number(value: Any) -> float:
    """The number; raises ValueError if it is outside the valid range of a view."""
    number = float(value)
    if not abs(number) <= FARTHEST:  # also NaN
        raise ValueError(value)
    return number


def _pose(kept: Any) -> ViewPose:
    x, y, z = _numbers(kept["position"], 3)
    others = {name: _number(kept[name]) for name in ("heading", "elevation", "reach", "fov")}
    return ViewPose((x, y, z), **others)
