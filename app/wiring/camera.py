"""Where the 3D view is seen from: places to go, and the frames of the trajectory one after another."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from app.actions import Action
from app.state.reasons import with_positions, with_selection, with_splat_file, with_trajectory
from app.wiring.part import Part, Workspace


class CameraPart(Part):
    ACTIONS = (
        Action(
            "home",
            "&Home",
            "Back to the start of the trajectory",
            "&Camera",
            shortcut="H",
            icon="home",
            toolbar=True,
            enabled=with_positions,
        ),
        Action(
            "overview",
            "Over&view",
            "The whole building from a raised corner",
            "&Camera",
            shortcut="O",
            icon="overview",
            toolbar=True,
            enabled=with_positions,
        ),
        Action(
            "above",
            "From &above",
            "Straight down, north up",
            "&Camera",
            shortcut="T",
            icon="above",
            toolbar=True,
            enabled=with_positions,
        ),
        Action(
            "turn_up",
            "Turn &upright",
            "Take the next axis of the splat file for up",
            "&Camera",
            shortcut="U",
            enabled=with_splat_file,
        ),
        Action(
            "focus",
            "&Focus on selection",
            "Bring what is selected before the camera",
            "&Camera",
            shortcut="F",
            icon="focus",
            toolbar=True,
            enabled=with_selection,
        ),
        Action(
            "walk",
            "&Walk",
            "Walk from the place one looks at: W, A, S, D and the wheel walk, walls stop, any other move ends it",
            "&Camera",
            shortcut="Ctrl+K",
            icon="walk",
            check="off",
            toolbar=True,
            enabled=with_positions,
        ),
        Action(
            "previous_frame",
            "&Previous frame",
            "Stand where the frame before was taken",
            "&Camera",
            1,
            "[",
            "previous",
            enabled=with_trajectory,
        ),
        Action(
            "next_frame",
            "&Next frame",
            "Stand where the next frame was taken",
            "&Camera",
            1,
            "]",
            "next",
            enabled=with_trajectory,
        ),
    )

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        workspace.scene.navigation.walkEnded.connect(self._end_walk)

    def handlers(self) -> Mapping[str, Callable[..., object]]:
        scene = self.workspace.scene
        return {
            "home": scene.home,
            "overview": scene.look_over,
            "above": scene.look_from_above,
            "turn_up": self.workspace.window.turnWanted.emit,
            "focus": scene.focus_on_selection,
            "walk": self._walk,
            "previous_frame": lambda: self._step_frame(-1),
            "next_frame": lambda: self._step_frame(1),
        }

    def _step_frame(self, step: int) -> None:
        document = self.workspace.document
        current = document.selection.frame
        frame = 0 if current is None else (current + step) % len(document.trajectory.positions)
        document.select(frame=frame)
        self.workspace.scene.snap_to_frame(frame)

    def _end_walk(self) -> None:
        self.workspace.window.actions_table["walk"].setChecked(False)

    def _walk(self, on: bool) -> None:
        scene = self.workspace.scene
        if not on:
            scene.navigation.walk(None)
        elif scene.navigation.walking is None:
            scene.navigation.walk(scene.places.walk, scene.places.walk_start)
