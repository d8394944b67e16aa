"""The view in the center of the window as a value, and the history of views with a text for each change. Does not use
Qt."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from nvsim_app.painting.cameras import ViewPose

MOST = 100
MERGED = 1.0  # maximum seconds between two opacity changes of a layer that are merged into one step
Layers = Mapping[str, tuple[bool, float]]
"""Layer name -> (shown, opacity)."""
_CHANNELS = {
    "rgb": "color",
    "alpha": "alpha",
    "normal": "normals",
    "depth": "depth",
    "hole": "the floor hole",
    "submap": "submap colors",
}


@dataclass(frozen=True)
class PageState:
    """The state of the frame page.

    frame   index of the frame on the page, None if the 3D view is shown
    mode    comparison with the render, one of frames.canvas.MODES
    layers  layers of the frame
    """

    frame: int | None = None
    mode: str = "wipe"
    layers: Layers = field(default_factory=dict)


@dataclass(frozen=True)
class ViewState:
    """The state of the 3D view and the frame page.

    pose      camera pose of the 3D view
    channel   one of tones.CHANNELS
    layers    layers of the 3D view
    renderer  one of renderer_choice.PREFERENCES
    budget    maximum number of rendered Gaussians, 0 for all
    page      the frame page
    """

    pose: ViewPose
    channel: str = "rgb"
    layers: Layers = field(default_factory=dict)
    renderer: str = "automatic"
    budget: int = 0
    page: PageState = field(default_factory=PageState)


def changes(before: ViewState, after: ViewState, titles: Callable[[str], str] = str) -> dict[str, str]:
    """The changes between two views: key -> text, the most important first. Layers that only one of them has are
    ignored. `titles` maps the name of a layer to its title."""
    found: dict[str, str] = {}
    a, b = before.page, after.page
    if a.frame != b.frame:
        found["page"] = "back to the 3D view" if b.frame is None else f"open frame {b.frame + 1:,}"
    if before.channel != after.channel:
        found["channel"] = f"show {_CHANNELS[after.channel]}"
    for kind, old, new in (("layer", before.layers, after.layers), ("frame layer", a.layers, b.layers)):
        for name in new:
            if name in old and old[name][0] != new[name][0]:
                found[f"{kind} {name}"] = f"{'show' if new[name][0] else 'hide'} {_lower(titles(name))}"
            if name in old and old[name][1] != new[name][1]:
                found[f"fade {kind} {name}"] = f"fade {_lower(titles(name))}"
    if a.mode != b.mode:
        found["mode"] = "compare side by side" if b.mode == "beside" else f"compare by {b.mode}"
    if before.renderer != after.renderer:
        found["renderer"] = f"renderer {after.renderer}"
    if before.budget != after.budget:
        words = f"render at most {after.budget:,} Gaussians" if after.budget else "render all Gaussians"
        found["budget"] = words.replace(",", "\u202f")
    if before.pose != after.pose:
        found["pose"] = "move the camera"
    return found


class ViewStates:
    """The history of views and the current position in it."""

    def __init__(self) -> None:
        self._states: list[ViewState] = []
        self._at = -1
        self._fading: tuple[frozenset[str], float] | None = None  # the last step if it was a fade, and its time
        self.pending = False  # whether a change waits to be recorded

    def clear(self) -> None:
        self._states, self._at, self._fading, self.pending = [], -1, None, False

    @property
    def current(self) -> ViewState | None:
        return self._states[self._at] if self._at >= 0 else None

    @property
    def previous(self) -> ViewState | None:
        """The view that `back` goes to, None if there is none."""
        return self._states[self._at - 1] if self._at > 0 else None

    @property
    def next(self) -> ViewState | None:
        """The view that `forward` goes to, None if there is none."""
        return self._states[self._at + 1] if self._at + 1 < len(self._states) else None

    def record(self, state: ViewState, now: float = 0.0) -> None:
        """Records a view that came to rest at `now` (seconds). If it differs from the current view, later views are
        discarded. Opacity changes of one layer in quick succession become one step."""
        current = self.current
        if current is None:
            self._states, self._at = [state], 0
            return
        what = frozenset(changes(current, state))
        if not what:
            self.replace_current(state)
            return
        fade = all(key.startswith("fade") for key in what)
        drags = fade and self._fading is not None and self._fading[0] == what and now - self._fading[1] < MERGED
        kept = self._at if drags and self.next is None else self._at + 1
        self._states = [*self._states[:kept], state][-MOST:]
        self._at = len(self._states) - 1
        self._fading = (what, now) if fade else None

    def record_pose(self, pose: ViewPose, now: float = 0.0) -> None:
        """Records a new camera pose; everything else is unchanged."""
        if self.current is not None:
            self.record(replace(self.current, pose=pose), now)

    def replace_current(self, state: ViewState) -> None:
        """Replaces the current view without a new step, for example if a layer was added or could not be restored."""
        if self._at >= 0:
            self._states[self._at] = state

    def back(self) -> ViewState | None:
        """Goes to the previous view; None at the first."""
        return self._go_to(self._at - 1)

    def forward(self) -> ViewState | None:
        """Goes to the next view; None at the last."""
        return self._go_to(self._at + 1)

    def _go_to(self, index: int) -> ViewState | None:
        if not 0 <= index < len(self._states):
            return None
        self._at, self._fading = index, None
        return self._states[index]


def _lower(title: str) -> str:
    return title[:1].lower() + title[1:]
