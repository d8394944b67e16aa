"""Commands of the camera: places to go to, and the frames of the trajectory in order."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from app.actions import Action
from app.state.reasons import with_positions, with_splat_file, with_trajectory
from app.wiring.panels import MapPart
from app.wiring.part import Part, WindowContext
from app.wiring.selecting import SelectPart


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
            "overview": scene.look_over,
            "above": scene.look_from_above,
            "turn_up": self.context.window.turnWanted.emit,
            "focus": self._focus,
            "walk": self._walk,
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
            scene.look_over()
            self.context.part(MapPart).view.frame_everything()

    def _step_frame(self, step: int) -> None:
        document = self.context.document
        current = document.selection.frame
        frame = 0 if current is None else (current + step) % len(document.trajectory.positions)
        document.select(frame=frame)
        self.context.scene.snap_to_frame(frame)

    def _end_walk(self) -> None:
        self.context.window.actions_table["walk"].setChecked(False)

    def _walk(self, on: bool) -> None:
        scene = self.context.scene
        if not on:
            scene.navigation.walk(None)
        elif scene.navigation.walking is None:
            scene.navigation.walk(scene.places.walk, scene.places.walk_start)
