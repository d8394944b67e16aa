"""Converts mouse and keyboard events to camera poses of the 3D view.

Drags orbit, pan, and look around, keys fly, and the wheel zooms, according to the `ControlSettings`. While walking, the
camera keeps its height above the floor and does not enter walls. Orbit drags then look around, and the wheel walks. Any
other motion of the camera ends the walk.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import ceil, hypot

from PySide6.QtCore import QObject, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QGuiApplication, QKeyEvent, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import QWidget

from nvsim_app.painting import cameras
from nvsim_app.painting.cameras import ViewPose

MOTIONS = {"turn": "orbit around the point ahead", "shift": "move sideways", "look": "look around in place"}


@dataclass(frozen=True)
class Flight:
    """A motion that a key controls: title, default key, and direction (forward, right, up)."""

    title: str
    key: str
    way: tuple[int, int, int]


FLIGHTS = {
    "fly_forward": Flight("Fly forward", "W", (1, 0, 0)),
    "fly_back": Flight("Fly back", "S", (-1, 0, 0)),
    "fly_right": Flight("Fly right", "D", (0, 1, 0)),
    "fly_left": Flight("Fly left", "A", (0, -1, 0)),
    "fly_up": Flight("Fly up", "E", (0, 0, 1)),
    "fly_down": Flight("Fly down", "Q", (0, 0, -1)),
}


def flight_directions(keys: Mapping[str, str]) -> dict[int, tuple[int, int, int]]:
    """Converts a mapping from names in FLIGHTS to key texts into a mapping from Qt key codes to directions. Unknown
    keys are omitted."""
    named = {name: getattr(Qt.Key, f"Key_{key}", None) for name, key in keys.items()}
    return {int(key): FLIGHTS[name].way for name, key in named.items() if key is not None}


@dataclass(frozen=True)
class ControlSettings:
    """The mouse and keyboard settings of the 3D view.

    left, middle, right   motion of a drag with the button, a key in MOTIONS; Shift changes "turn" to "shift"
    upside_down           whether dragging down looks up
    backwards             whether the direction of the wheel is reversed
    turning, rolling      sensitivity of dragging and of the wheel; 1 is the default
    keys                  Qt key code -> flying direction (forward, right, up)
    """

    left: str = "turn"
    middle: str = "shift"
    right: str = "look"
    upside_down: bool = False
    backwards: bool = False
    turning: float = 1.0
    rolling: float = 1.0
    keys: Mapping[int, tuple[int, int, int]] = field(
        default_factory=lambda: flight_directions({name: flight.key for name, flight in FLIGHTS.items()})
    )

    def motion(self, buttons: Qt.MouseButton, shift: bool) -> str:
        """The motion of a drag with these buttons, "" for none. Of several buttons, the right one takes precedence,
        then the middle one."""
        for button, motion in (
            (Qt.MouseButton.RightButton, self.right),
            (Qt.MouseButton.MiddleButton, self.middle),
            (Qt.MouseButton.LeftButton, self.left),
        ):
            if buttons & button:
                return "shift" if shift and motion == "turn" else motion
        return ""


CLICK_TOLERANCE = 4  # maximum movement of a click, pixels
_TICK = 15  # milliseconds
_NOTCH = 0.3  # meters walked per notch of the wheel
_PIECE = 0.1  # maximum distance between two checks for obstacles, meters
_SETTLE = 0.12  # time constant of the height of a walking camera after a step in the floor, seconds


@dataclass(frozen=True)
class WalkLimits:
    """The constraints of walking.

    eye_level  maps x, y, z to the world z of a walking camera at x, y on the storey below z
    free       maps x, y, z to whether a camera at height z may be at x, y
    """

    eye_level: Callable[[float, float, float], float]
    free: Callable[[float, float, float], bool] = lambda x, y, z: True


class Navigation(QObject):
    """Controls the camera of the 3D view.

    moved()       `pose` changed
    walkEnded()   a motion other than a step ended the walk
    """

    moved = Signal()
    walkEnded = Signal()

    def __init__(self, view: QWidget) -> None:
        super().__init__(view)
        self._view = view
        self.pose = ViewPose((0.0, 0.0, 1.6))
        self.speed = 2.0  # meters per second
        self.hands = ControlSettings()
        self.walking: WalkLimits | None = None
        """The constraints of the current walk, None while flying."""
        self._held: set[int] = set()
        self._last: QPointF | None = None
        self._pressed_at: QPointF | None = None
        self._dragged = False
        self._before = 0.0
        self._flight: tuple[ViewPose, ViewPose, float, float] | None = None
        self._timer = QTimer(self)
        self._timer.setInterval(_TICK)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._tick)

    @property
    def active(self) -> bool:
        """Whether keys, a drag, or an animation currently move the camera."""
        return self._timer.isActive() or self._dragged

    @property
    def goal(self) -> ViewPose:
        """The target pose of the current animation, or the current pose."""
        return self.pose if self._flight is None else self._flight[1]

    def walk(self, walk: WalkLimits | None, start: ViewPose | None = None) -> None:
        """Begins a walk at `start`, by default at the current pose. If `walk` is None, ends the walk."""
        self.walking = walk
        if walk is not None:
            self._fly(self.pose if start is None else start)

    def set_pose(self, pose: ViewPose) -> None:
        """Moves the camera immediately and ends a walk."""
        self._end_walk()
        self._set_pose(pose)

    def go_to(self, pose: ViewPose) -> None:
        """Moves the camera to `pose` in an animation, and ends a walk."""
        self._end_walk()
        self._fly(pose)

    def _set_pose(self, pose: ViewPose) -> None:
        self._flight = None
        if pose != self.pose:
            self.pose = pose
            self.moved.emit()

    def _fly(self, pose: ViewPose, seconds: float = 0.35) -> None:
        self._flight = (self.pose, pose, time.monotonic(), seconds)
        self._start()

    def _end_walk(self) -> None:
        if self.walking is not None:
            self.walking = None
            self.walkEnded.emit()

    def press(self, event: QMouseEvent) -> None:
        self._flight = None
        self._last = self._pressed_at = event.position()
        self._dragged = False

    def drag(self, event: QMouseEvent) -> bool:
        """Handles a mouse movement. Returns whether it moved the camera; False if it is still a click."""
        if self._last is None or self._pressed_at is None or not event.buttons():
            return False
        if not self._dragged and (event.position() - self._pressed_at).manhattanLength() <= CLICK_TOLERANCE:
            return False
        self._dragged = True
        step = event.position() - self._last
        self._last = event.position()
        dx, dy, buttons = step.x(), step.y(), event.buttons()
        shift = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        motion, share = self.hands.motion(buttons, shift), self.hands.turning
        down = -dy if self.hands.upside_down else dy
        if motion == "look" or (motion == "turn" and self.walking is not None):
            angle = cameras.RADIANS_PER_PIXEL * 0.8 * share
            self._set_pose(cameras.turn_pose(self.pose, dx * angle, -down * angle))
        elif motion == "shift":
            self.set_pose(cameras.pan_pose(self.pose, dx, dy, max(1, self._view.height())))
        elif motion == "turn":
            self.set_pose(cameras.orbit_pose(self.pose, dx * share, down * share))
        return True

    def release(self) -> bool:
        """Handles the release of a button. Returns whether it was a click."""
        click = self._pressed_at is not None and not self._dragged
        self._last = self._pressed_at = None
        self._dragged = False
        return click

    def wheel(self, event: QWheelEvent) -> None:
        notches = event.angleDelta().y() / 120
        if self.hands.motion(event.buttons(), shift=False) == "look":
            self.speed = min(max(self.speed * 1.25**notches, 0.1), 50.0)
            return
        notches *= -self.hands.rolling if self.hands.backwards else self.hands.rolling
        if self.walking is not None:
            self._set_pose(self._step_with_obstacles(self.pose, _NOTCH * notches, 0.0))
            return
        camera = self.pose.camera(max(1, self._view.width()), max(1, self._view.height()))
        k, at = camera.intrinsics, event.position()
        ray = camera.rotation @ [(at.x() - k.cx) / k.fx, (at.y() - k.cy) / k.fy, 1.0]
        self.set_pose(cameras.zoomed(self.pose, 0.85**notches, ray / (ray @ ray) ** 0.5))

    def key(self, event: QKeyEvent, down: bool) -> bool:
        """Handles a key. Returns whether it is a key for flying."""
        plain = not event.modifiers() & (Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier)
        if event.key() not in self.hands.keys or (down and not plain):
            return False
        if not event.isAutoRepeat():
            (self._held.add if down else self._held.discard)(event.key())
            self._start()
        return True

    def release_all(self) -> None:
        """Discards pressed keys and drags. Call it when the focus is lost, because their release is not received."""
        self._held.clear()
        self._last = self._pressed_at = None
        self._dragged = False

    def stop(self) -> None:
        self.release_all()
        self._flight = None
        self._timer.stop()

    def _start(self) -> None:
        if not self._timer.isActive():
            self._before = time.monotonic()
            self._timer.start()

    def _tick(self) -> None:
        now = time.monotonic()
        elapsed, self._before = min(now - self._before, 0.1), now
        if self._flight is not None:
            start, goal, begin, seconds = self._flight
            share = min(1.0, (now - begin) / seconds)
            self.pose = goal if share >= 1 else cameras.interpolate_poses(start, goal, share)
            if share >= 1:
                self._flight = None
            self.moved.emit()
        if self._held and (self.walking is None or self._flight is None):  # a walk starts with an animation
            fast = QGuiApplication.keyboardModifiers() & Qt.KeyboardModifier.ShiftModifier
            meters = self.speed * elapsed * (3.0 if fast else 1.0)
            ways = self.hands.keys
            forward, right, up = (meters * sum(ways[k][i] for k in self._held if k in ways) for i in range(3))
            if self.walking is None:
                self.set_pose(cameras.fly_pose(self.pose, forward, right, up))
            else:
                self._set_pose(self._adjust_height(self._step_with_obstacles(self.pose, forward, right), elapsed))
        if not self._held and self._flight is None:
            self._timer.stop()

    def _step_with_obstacles(self, pose: ViewPose, forward: float, right: float) -> ViewPose:
        """The pose after a horizontal step. The step ends at obstacles and slides along walls."""
        assert self.walking is not None
        x, y, z = pose.position
        goal = cameras.walk_pose(pose, forward, right).position
        pieces = max(1, ceil(hypot(goal[0] - x, goal[1] - y) / _PIECE))
        dx, dy = (goal[0] - x) / pieces, (goal[1] - y) / pieces
        for _ in range(pieces):
            for there in ((x + dx, y + dy), (x + dx, y), (x, y + dy)):
                if self.walking.free(*there, z):
                    x, y = there
                    break
        return replace(pose, position=(x, y, z))

    def _adjust_height(self, pose: ViewPose, elapsed: float) -> ViewPose:
        """`pose` with its height moved gradually to the eye level, so that steps in the floor are smooth."""
        assert self.walking is not None
        x, y, z = pose.position
        share = min(1.0, elapsed / _SETTLE)
        return replace(pose, position=(x, y, z + share * (self.walking.eye_level(x, y, z) - z)))
