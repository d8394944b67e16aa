"""The modes of editing. They work in the map and in the 3D view. `MODES` lists them by name."""

from __future__ import annotations

from nvsim_app.modes.adding import AddEdgeMode, AddViewpointMode
from nvsim_app.modes.measure import MeasureMode
from nvsim_app.modes.mode import Mode
from nvsim_app.modes.select import BoxMode, LassoMode, SelectMode

MODES: dict[str, type[Mode]] = {
    mode.name: mode for mode in (SelectMode, BoxMode, LassoMode, AddViewpointMode, AddEdgeMode, MeasureMode)
}
