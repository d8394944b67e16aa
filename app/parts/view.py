"""What the 3D view shows: the channel, and who draws it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings

from app.actions import Action
from app.parts.part import Part
from app.reasons import with_scene
from app.renderer_choice import AUTOMATIC, CPU, OPENGL, PREFERENCES
from app.tones import CHANNELS


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
        return handlers

    def restore(self, settings: QSettings) -> None:
        renderer = settings.value("renderer", AUTOMATIC)
        if renderer in PREFERENCES:
            self.workspace.scene.renderer = str(renderer)
            self.workspace.window.actions_table[f"renderer_{renderer}"].setChecked(True)

    def _set_renderer(self, renderer: str) -> None:
        self.workspace.settings.setValue("renderer", renderer)
        self.workspace.scene.set_renderer(renderer)
