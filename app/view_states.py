"""What the 3D view shows and from where, as a value; the views that were, to go back to; and as text to be kept."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from app.cameras import ViewPose
from app.document import Selection
from app.tones import CHANNELS

MOST = 100


@dataclass(frozen=True)
class ViewState:
    """layers: name -> (shown, opacity)."""

    pose: ViewPose
    channel: str = "rgb"
    layers: Mapping[str, tuple[bool, float]] = field(default_factory=dict)


class ViewStates:
    """The views that were, and where among them one is."""

    def __init__(self) -> None:
        self._states: list[ViewState] = []
        self._at = -1

    def clear(self) -> None:
        self._states, self._at = [], -1

    def record(self, state: ViewState) -> None:
        """The view came to rest. What one could have gone forward to is gone, unless nothing changed."""
        if self._at >= 0 and self._states[self._at] == state:
            return
        self._states = [*self._states[: self._at + 1], state][-MOST:]
        self._at = len(self._states) - 1

    def back(self) -> ViewState | None:
        """The one before; None at the first."""
        return self._go(self._at - 1)

    def forward(self) -> ViewState | None:
        """The one after; None at the last."""
        return self._go(self._at + 1)

    def _go(self, index: int) -> ViewState | None:
        if not 0 <= index < len(self._states):
            return None
        self._at = index
        return self._states[index]


def encode(pose: ViewPose | None, channel: str, selection: Selection) -> str:
    """What of a project's view comes back with the next window; layers are everybody's."""
    kept = {"pose": None if pose is None else asdict(pose), "channel": channel, "selection": asdict(selection)}
    return json.dumps(kept)


def decode(text: str) -> tuple[ViewPose | None, str, Selection] | None:
    """What `encode` kept; None for anything else."""
    try:
        kept = json.loads(text)
        pose = kept["pose"]
        if pose is not None:
            x, y, z = (float(v) for v in pose["position"])
            others = {name: float(pose[name]) for name in ("heading", "elevation", "reach", "fov")}
            pose = ViewPose((x, y, z), **others)
        channel, chosen = kept["channel"], kept["selection"]
        viewpoint, frame, submap = chosen["viewpoint"], chosen["frame"], chosen["submap"]
    except (ValueError, KeyError, TypeError):
        return None
    fits = channel in CHANNELS and isinstance(viewpoint, str | None)
    fits = fits and isinstance(frame, int | None) and isinstance(submap, int | None)
    return (pose, channel, Selection(viewpoint, frame, submap)) if fits else None
