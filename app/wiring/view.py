"""The channel and the renderer of the 3D view."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings

from app.actions import Action
from app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL, PREFERENCES
from app.painting.tones import CHANNELS
from app.panels.preferences import BUDGETS
from app.state.reasons import with_scene, with_submaps
from app.wiring.part import Part


class ViewPart(Part):
    """Commands that select the channel, the renderer, and the number of Gaussians."""

    ACTIONS = (
        Action("rgb", "&Color", "Show colors", "&View", shortcut="1", icon="rgb", check="on", group="channel",
               toolbar=True, enabled=with_scene),
        Action("alpha", "&Alpha", "Show occupancy: white is opaque, black is floor or empty space", "&View",
               shortcut="2", icon="alpha", check="off", group="channel", toolbar=True, enabled=with_scene),
        Action("normal", "&Normals", "Show surface normals", "&View", shortcut="3", icon="normal", check="off",
               group="channel", toolbar=True, enabled=with_scene),
        Action("depth", "&Depth", "Show depth: near is bright", "&View", shortcut="4", icon="depth", check="off",
               group="channel", toolbar=True, enabled=with_scene),
        Action("submap", "&Submap colors", "Show the brightness in the color of the nearest submap", "&View",
               shortcut="5", icon="submap", check="off", group="channel", toolbar=True, enabled=with_submaps),
        Action("hole", "Floor &hole",
               "Show the Gaussians without the background; pixels without Gaussians, the floor hole, are pink", "&View",
               shortcut="6", icon="hole", check="off", group="channel", toolbar=True, enabled=with_scene),
        *(
            Action(
                f"budget_{count}",
                f"Draw at most {count:,} Gaussians".replace(",", "\u202f") if count else "Draw &all Gaussians",
                "Draw only the Gaussians that cover most of the image, for a computer that is too slow to draw all"
                if count
                else "Draw every Gaussian of the submap",
                "&View",
                3,
                check="off" if count else "on",
                group="budget",
                enabled=with_scene,
            )
            for count in BUDGETS
        ),
        Action(f"renderer_{AUTOMATIC}", "Renderer: a&utomatic",
               "Render colors with the faster renderer; both are measured", "&View", 2, check="on", group="renderer",
               enabled=with_scene),
        Action(f"renderer_{CPU}", "Renderer: &CPU", "Render with the CPU", "&View", 2, check="off", group="renderer",
               enabled=with_scene),
        Action(f"renderer_{OPENGL}", "Renderer: &OpenGL",
               "Render colors with the graphics card; the CPU renders the other channels", "&View", 2, check="off",
               group="renderer", enabled=with_scene),
    )  # fmt: skip

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        scene = self.context.scene
        handlers: dict[str, Callable[..., object]] = {}
        for channel in CHANNELS:
            handlers[channel] = lambda _=False, c=channel: scene.set_channel(c)
        for renderer in PREFERENCES:
            handlers[f"renderer_{renderer}"] = lambda _=False, r=renderer: self._set_renderer(r)
        for count in BUDGETS:
            handlers[f"budget_{count}"] = lambda _=False, n=count: self._set_budget(n)
        return handlers

    def restore(self, settings: QSettings) -> None:
        self.context.preferences.changed.connect(self._apply)
        self._apply("renderer")
        self._apply("splat_budget")

    def _set_budget(self, count: int) -> None:
        self.context.preferences.set("splat_budget", str(count))

    def _set_renderer(self, renderer: str) -> None:
        self.context.preferences.set("renderer", renderer)

    def _apply(self, key: str) -> None:
        scene, value = self.context.scene, str(self.context.preferences[key])
        if key == "renderer":
            scene.set_renderer(value)
            self.context.window.actions_table[f"renderer_{value}"].setChecked(True)
        elif key == "splat_budget":
            scene.set_budget(int(value))
            self.context.window.actions_table[f"budget_{value}"].setChecked(True)
