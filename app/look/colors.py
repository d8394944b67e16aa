"""Colours that mean something: the same in both themes, on the map, in the 3D view and in lists."""

from __future__ import annotations

NODE = "#2ec4b6"
NODE_OUTLINE = "#0b2b29"
EDGE = "#2ec4b6"
SELECTED = "#ffd166"
TRAJECTORY = "#9aa5b1"
CAMERA = "#ff6b6b"
AGENT = "#8f57cc"
OPEN = "#3fb37f"
BLOCKED = "#e05d5d"
UNDECIDED = "#8d99a6"
# The same meanings as text: dark enough for white paper, light enough for a dark one.
RUNNING_TEXT = "#169c8f"
OPEN_TEXT = "#2f9e6c"
BLOCKED_TEXT = "#dd5555"
WARNING_TEXT = "#c27c0e"
QUIET_TEXT = "#7f8b98"

# Twelve hues that stay apart for most kinds of colour vision, in an order that keeps neighbours different.
SUBMAPS = (
    "#4e79a7", "#f28e2b", "#59a14f", "#e15759", "#b07aa1", "#edc948",
    "#76b7b2", "#ff9da7", "#9c755f", "#86bc4d", "#6f8fe0", "#d37295",
)  # fmt: skip

OCCUPANCY_DARK = {"free": (58, 66, 78), "occupied": (186, 196, 208), "unknown": (31, 35, 41)}
OCCUPANCY_LIGHT = {"free": (255, 255, 255), "occupied": (72, 80, 92), "unknown": (222, 226, 231)}


def submap_color(index: int) -> str:
    """#rrggbb of the submap; grey for none (-1)."""
    return TRAJECTORY if index < 0 else SUBMAPS[index % len(SUBMAPS)]
