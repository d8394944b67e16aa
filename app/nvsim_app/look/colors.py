"""Colors with a meaning. They are the same in both themes, on the map, in the 3D view, and in lists. Only text colors
depend on the theme."""

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
WARNING = "#c27c0e"
# Text colors of these meanings, with a contrast of 4.5 to 1 or better on every background of their theme. No color
# reaches that in both themes.
TEXTS = {
    "dark": {
        "running": "#3cc9bc",
        "open": "#4fc08d",
        "blocked": "#f07f7f",
        "warning": "#e0a13c",
        "quiet": "#97a3b0",
    },
    "light": {
        "running": "#0f766e",
        "open": "#1d7a50",
        "blocked": "#c03535",
        "warning": "#8f5a00",
        "quiet": "#5c6773",
    },
}
_theme = ["dark"]

# Twelve hues that are distinct for most kinds of color vision, ordered so that neighbors differ clearly.
SUBMAPS = (
    "#4e79a7", "#f28e2b", "#59a14f", "#e15759", "#b07aa1", "#edc948",
    "#76b7b2", "#ff9da7", "#9c755f", "#86bc4d", "#6f8fe0", "#d37295",
)  # fmt: skip

OCCUPANCY_DARK = {"free": (58, 66, 78), "occupied": (186, 196, 208), "unknown": (31, 35, 41)}
OCCUPANCY_LIGHT = {"free": (255, 255, 255), "occupied": (72, 80, 92), "unknown": (222, 226, 231)}


def set_text_theme(theme: str) -> None:
    """Sets the theme of text colors: "dark" or "light"."""
    _theme[0] = theme


def text(meaning: str) -> str:
    """#rrggbb of text with this meaning (a key in TEXTS) in the current theme."""
    return TEXTS[_theme[0]][meaning]


def submap_color(index: int) -> str:
    """#rrggbb of the submap; gray for none (-1)."""
    return TRAJECTORY if index < 0 else SUBMAPS[index % len(SUBMAPS)]
