"""What the 3D view shows: the channel, and who draws it."""

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
    ACTIONS = (
        Action(
            "rgb",
            "&Colour",
            "Show colours",
            "&View",
            shortcut="1",
            icon="rgb",
            check="on",
            group="channel",
            toolbar=True,
            enabled=with_scene,
        ),
        Action(
            "alpha",
            "&Alpha",
            "Show where something stands: white is opaque, black is floor or emptiness",
            "&View",
            shortcut="2",
            icon="alpha",
            check="off",
            group="channel",
            toolbar=True,
            enabled=with_scene,
        ),
        Action(
            "normal",
            "&Normals",
            "Show which way surfaces face",
            "&View",
            shortcut="3",
            icon="normal",
            check="off",
            group="channel",
            toolbar=True,
            enabled=with_scene,
        ),
        Action(
            "depth",
            "&Depth",
            "Show distance: near is bright",
            "&View",
            shortcut="4",
            icon="depth",
            check="off",
            group="channel",
            toolbar=True,
            enabled=with_scene,
        ),
        Action(
            "submap",
            "&Submap colours",
            "Show which submap draws what: brightness in the colour of the nearest submap",
            "&View",
            shortcut="5",
            icon="submap",
            check="off",
            group="channel",
            toolbar=True,
            enabled=with_submaps,
        ),
        Action(
            "hole",
            "Floor &hole",
            "Show the Gaussians without the background: where none is, the floor hole, is pink",
            "&View",
            shortcut="6",
            icon="hole",
            check="off",
            group="channel",
            toolbar=True,
            enabled=with_scene,
        ),
        *(
            Action(
                f"budget_{count}",
                f"Draw at most {count:,} Gaussians".replace(",", "\u202f") if count else "Draw &all Gaussians",
                "Those that cover most, for a machine that cannot draw all of them in time"
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
        Action(
            f"renderer_{AUTOMATIC}",
            "Renderer: a&utomatic",
            "Draw colours with whichever is faster here: both are timed",
            "&View",
            2,
            check="on",
            group="renderer",
            enabled=with_scene,
        ),
        Action(
            f"renderer_{CPU}",
            "Renderer: &CPU",
            "Always draw with the processor",
            "&View",
            2,
            check="off",
            group="renderer",
            enabled=with_scene,
        ),
        Action(
            f"renderer_{OPENGL}",
            "Renderer: &OpenGL",
            "Draw colours with the graphics card; the other views stay with the processor",
            "&View",
            2,
            check="off",
            group="renderer",
            enabled=with_scene,
        ),
    )

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        scene = self.workspace.scene
        handlers: dict[str, Callable[..., object]] = {}
        for channel in CHANNELS:
            handlers[channel] = lambda _=False, c=channel: scene.set_channel(c)
        for renderer in PREFERENCES:
            handlers[f"renderer_{renderer}"] = lambda _=False, r=renderer: self._set_renderer(r)
        for count in BUDGETS:
            handlers[f"budget_{count}"] = lambda _=False, n=count: self._set_budget(n)
        return handlers

    def restore(self, settings: QSettings) -> None:
        self.workspace.preferences.changed.connect(self._apply)
        self._apply("renderer")
        self._apply("splat_budget")

    def _set_budget(self, count: int) -> None:
        self.workspace.preferences.set("splat_budget", str(count))

    def _set_renderer(self, renderer: str) -> None:
        self.workspace.preferences.set("renderer", renderer)

    def _apply(self, key: str) -> None:
        scene, value = self.workspace.scene, str(self.workspace.preferences[key])
        if key == "renderer":
            scene.set_renderer(value)
            self.workspace.window.actions_table[f"renderer_{value}"].setChecked(True)
        elif key == "splat_budget":
            scene.set_budget(int(value))
            self.workspace.window.actions_table[f"budget_{value}"].setChecked(True)
