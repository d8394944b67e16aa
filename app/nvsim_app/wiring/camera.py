"""Commands of the 3D view: places to go to, the frames of the trajectory in order, the channel, and the renderer."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QSettings

from nvsim_app.actions import Action
from nvsim_app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL
from nvsim_app.panels.preferences import BUDGETS
from nvsim_app.state.document import Document
from nvsim_app.state.reasons import Reason, with_positions, with_scene, with_splat_file, with_submaps, with_trajectory
from nvsim_app.wiring.panels import MapPart
from nvsim_app.wiring.part import Part, WindowContext
from nvsim_app.wiring.selecting import SelectPart


class CameraPart(Part):
    """Moves the camera of the 3D view."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        context.scene.navigation.walkEnded.connect(self._end_walk)

    def _focus(self) -> None:
        document, scene = self.context.document, self.context.scene
        if document.editing.selection:
            self.context.part(SelectPart).show_selection(document.editing.selection)
        elif document.selection:
            scene.places.focus_on_selection()
        else:
            scene.places.show_overview()
            self.context.part(MapPart).view.frame_everything()

    def _step_frame(self, step: int) -> None:
        document = self.context.document
        current = document.selection.frame
        frame = 0 if current is None else (current + step) % len(document.trajectory.positions)
        document.select(frame=frame)
        self.context.scene.places.snap_to_frame(frame)

    def _end_walk(self) -> None:
        self.context.window.actions_table["walk"].setChecked(False)

    def _set_walking(self, on: bool) -> None:
        scene = self.context.scene
        if not on:
            scene.navigation.walk(None)
        elif scene.navigation.walking is None:
            scene.navigation.walk(scene.places.walk_limits, scene.places.walk_start)

    ACTIONS = (
        Action("&Camera", 0, "home", "&Home", "Go to the start of the trajectory",
               lambda self: self.context.scene.places.home(), "H", with_positions, icon="home", toolbar=True),
        Action("&Camera", 0, "overview", "Over&view", "Show the whole building from a raised corner",
               lambda self: self.context.scene.places.show_overview(), "O", with_positions, icon="overview",
               toolbar=True),
        Action("&Camera", 0, "above", "From &above", "Look straight down, north up",
               lambda self: self.context.scene.places.look_from_above(), "T", with_positions, icon="above",
               toolbar=True),
        Action("&Camera", 0, "turn_up", "Turn &upright", "Use the next axis of the splat file as up",
               lambda self: self.context.window.turnWanted.emit(), "U", with_splat_file),
        Action("&Camera", 0, "focus", "&Focus",
               "Show the selection in both views, or everything if nothing is selected", _focus, "F", with_positions,
               icon="focus", toolbar=True),
        Action("&Camera", 0, "walk", "&Walk",
               "Walk on the floor: W, A, S, D and the wheel move, walls stop you, any other move ends the walk",
               _set_walking, "Ctrl+K", with_positions, icon="walk", check="off", toolbar=True),
        Action("&Camera", 1, "previous_frame", "&Previous frame", "Go to the camera of the previous frame",
               lambda self: self._step_frame(-1), "[", with_trajectory, icon="previous"),
        Action("&Camera", 1, "next_frame", "&Next frame", "Go to the camera of the next frame",
               lambda self: self._step_frame(1), "]", with_trajectory, icon="next"),
    )  # fmt: skip


def _channel(id: str, text: str, tip: str, shortcut: str, enabled: Callable[[Document], Reason] = with_scene) -> Action:
    return Action("&View", 0, id, text, tip, lambda part: part.context.scene.set_channel(id), shortcut, enabled,
                  icon=id, check="on" if id == "rgb" else "off", group="channel", toolbar=True)  # fmt: skip


def _renderer(name: str, text: str, tip: str) -> Action:
    return Action("&View", 2, f"renderer_{name}", text, tip,
                  lambda part: part.context.preferences.set("renderer", name), enabled=with_scene,
                  check="on" if name == AUTOMATIC else "off", group="renderer")  # fmt: skip


def _budget(count: int) -> Action:
    text, tip = "Draw &all Gaussians", "Draw every Gaussian of the submap"
    if count:
        text = f"Draw at most {count:,} Gaussians".replace(",", "\u202f")
        tip = "Draw only the Gaussians that cover most of the image, for a computer that is too slow to draw all"
    return Action("&View", 3, f"budget_{count}", text, tip,
                  lambda part: part.context.preferences.set("splat_budget", str(count)), enabled=with_scene,
                  check="off" if count else "on", group="budget")  # fmt: skip


class ViewPart(Part):
    """Commands that select the channel, the renderer, and the number of Gaussians."""

    def restore(self, settings: QSettings) -> None:
        self.context.preferences.changed.connect(self._apply)
        self._apply("renderer")
        self._apply("splat_budget")

    def _apply(self, key: str) -> None:
        scene, value = self.context.scene, str(self.context.preferences[key])
        if key == "renderer":
            scene.set_renderer(value)
            self.context.window.actions_table[f"renderer_{value}"].setChecked(True)
        elif key == "splat_budget":
            scene.set_budget(int(value))
            self.context.window.actions_table[f"budget_{value}"].setChecked(True)

    ACTIONS = (
        _channel("rgb", "&Color", "Show colors", "1"),
        _channel("alpha", "&Alpha", "Show occupancy: white is opaque, black is floor or empty space", "2"),
        _channel("normal", "&Normals", "Show surface normals", "3"),
        _channel("depth", "&Depth", "Show depth: near is bright", "4"),
        _channel("submap", "&Submap colors", "Show the brightness in the color of the nearest submap", "5",
                 with_submaps),
        _channel("hole", "Floor &hole",
                 "Show the Gaussians without the background; pixels without Gaussians, the floor hole, are pink", "6"),
        *(_budget(count) for count in BUDGETS),
        _renderer(AUTOMATIC, "Renderer: a&utomatic", "Render colors with the faster renderer; both are measured"),
        _renderer(CPU, "Renderer: &CPU", "Render with the CPU"),
        _renderer(OPENGL, "Renderer: &OpenGL",
                  "Render colors with the graphics card; the CPU renders the other channels"),
    )  # fmt: skip
