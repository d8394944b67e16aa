"""Commands of the 3D view: places to go to, the frames of the trajectory in order, the channel, and the renderer."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import QSettings

from nvsim_app.actions import Action
from nvsim_app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL, PREFERENCES
from nvsim_app.painting.value_colors import CHANNELS
from nvsim_app.panels.preferences import BUDGETS
from nvsim_app.state.reasons import with_positions, with_scene, with_splat_file, with_submaps, with_trajectory
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import Part, WindowContext
from nvsim_app.wiring.selecting import SelectPart


class CameraPart(Part):
    """Moves the camera of the 3D view."""

    ACTIONS = (
        Action("home", "&Home", "Go to the start of the trajectory", "&Camera", shortcut="H", icon="home", toolbar=True,
               enabled=with_positions),
        Action("overview", "Over&view", "Show the whole building from a raised corner", "&Camera", shortcut="O",
               icon="overview", toolbar=True, enabled=with_positions),
        Action("above", "From &above", "Look straight down, north up", "&Camera", shortcut="T", icon="above",
               toolbar=True, enabled=with_positions),
        Action("turn_up", "Turn &upright", "Use the next axis of the splat file as up", "&Camera", shortcut="U",
               enabled=with_splat_file),
        Action("focus", "&Focus", "Show the selection in both views, or everything if nothing is selected", "&Camera",
               shortcut="F", icon="focus", toolbar=True, enabled=with_positions),
        Action("walk", "&Walk",
               "Walk on the floor: W, A, S, D and the wheel move, walls stop you, any other move ends the walk",
               "&Camera", shortcut="Ctrl+K", icon="walk", check="off", toolbar=True, enabled=with_positions),
        Action("previous_frame", "&Previous frame", "Go to the camera of the previous frame", "&Camera", 1, "[",
               "previous", enabled=with_trajectory),
        Action("next_frame", "&Next frame", "Go to the camera of the next frame", "&Camera", 1, "]", "next",
               enabled=with_trajectory),
    )  # fmt: skip

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        context.scene.navigation.walkEnded.connect(self._end_walk)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        scene = self.context.scene
        return {
            "home": scene.home,
            "overview": scene.show_overview,
            "above": scene.look_from_above,
            "turn_up": self.context.window.turnWanted.emit,
            "focus": self._focus,
            "walk": self._set_walking,
            "previous_frame": lambda: self._step_frame(-1),
            "next_frame": lambda: self._step_frame(1),
        }

    def _focus(self) -> None:
        document, scene = self.context.document, self.context.scene
        if document.editing.selection:
            self.context.part(SelectPart).show_selection(document.editing.selection)
        elif document.selection:
            scene.focus_on_selection()
        else:
            scene.show_overview()
            self.context.part(MapPart).view.frame_everything()

    def _step_frame(self, step: int) -> None:
        document = self.context.document
        current = document.selection.frame
        frame = 0 if current is None else (current + step) % len(document.trajectory.positions)
        document.select(frame=frame)
        self.context.scene.snap_to_frame(frame)

    def _end_walk(self) -> None:
        self.context.window.actions_table["walk"].setChecked(False)

    def _set_walking(self, on: bool) -> None:
        scene = self.context.scene
        if not on:
            scene.navigation.walk(None)
        elif scene.navigation.walking is None:
            scene.navigation.walk(scene.places.walk_limits, scene.places.walk_start)


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
