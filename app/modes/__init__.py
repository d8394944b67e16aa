"""The modes of editing. They work in the map and in the 3D view. `MODES` lists them by name."""

from __future__ import annotations

from app.modes.adding import AddEdgeMode, AddViewpointMode
from app.modes.measure import MeasureMode
from app.modes.mode import Mode
from app.modes.select import BoxMode, LassoMode, SelectMode

MODES: dict[str, type[Mode]] = {
    mode.name: mode for mode in (SelectMode, BoxMode, LassoMode, AddViewpointMode, AddEdgeMode, MeasureMode)
}
