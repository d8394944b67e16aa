"""The open frame: brings its photo, the render from its camera, its masks and its candidates onto the page, and what is
corrected there to disk."""

from __future__ import annotations

from itertools import count
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from app import cameras
from app.document import Document
from app.frames import pictures
from app.frames.brush import Box
from app.frames.corrector import Corrector
from app.frames.layers import CANDIDATES, FrameLayer, standard_layers
from app.frames.link import FrameLink
from app.frames.matter import Failure, Matter, Reader
from app.frames.model import coverage_words
from app.frames.page import FramePage
from app.frames.state import FrameState
from app.layers.frame_mask import FrameMaskLayer
from app.notices import Notices
from app.render_child import Picture, Request
from app.scene_view import SceneView
from nvsim.errors import InputError
from nvsim.perception.hybrid import HybridSteps
from nvsim.perception.prompted_network import prompted_files
from nvsim.project.layout import Layout

_VIEW = "frame"  # how requests of this page are told from the 3D view's
TOOLS = ("brush", "points")
_HINTS = {
    "": "Wheel zooms, drag moves, double-click fits; Page Up and Page Down go through the walk, Esc goes back",
    "brush": "Left paints floor, right erases it; wheel or [ ] sets the size, Shift draws straight, Ctrl+wheel zooms, "
    "Ctrl+Z takes back",
    "points": "Left: this surface is floor; right: this is none; wheel zooms, middle drag moves, Ctrl+Z takes back",
}
_NO_MODEL = "No submap is trained yet, so there is nothing to compare with."
_NO_MASK = "No floor mask yet: find the floors first (nvsim floors)."


class FrameBrowser(QObject):
    """opened(): the page wants to be seen; left(): it wants to be left; toolChanged(str)."""

    opened = Signal()
    left = Signal()
    toolChanged = Signal(str)

    def __init__(
        self, document: Document, scene: SceneView, state: FrameState, notices: Notices, parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._document, self._scene, self._state, self._notices = document, scene, state, notices
        self.layers = standard_layers()
        self._layer = {layer.name: layer for layer in self.layers}
        self.page = FramePage(self.layers)
        self._reader = Reader(self)
        self._candidates = FrameLink(self)
        self.corrector = Corrector(self._reader, self)
        self.over_scene = FrameMaskLayer()
        scene.overlays.add(self.over_scene, below="graph")
        self.tool = ""
        self.index: int | None = None  # of the frame on the page
        self.matter: Matter | None = None
        self._numbers = count()
        self._waits = False  # a point waits for a network or for normals
        self._asked_for: int | None = None  # whose candidates are being made
        self._soon = QTimer(self, singleShot=True, interval=30)
        self._soon.timeout.connect(self._ask_render)
        self._connect()

    def _connect(self) -> None:
        document, page, corrector = self._document, self.page, self.corrector
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        document.selectionChanged.connect(self._on_selection)
        self._scene.overlays.changed.connect(self._on_selection)
        self._scene.link.arrived.connect(self._on_picture)
        self._scene.link.opened.connect(lambda _: self._soon.start())
        self._state.changed.connect(self._say_title)
        self._reader.read.connect(self._on_matter)
        self._reader.candidatesRead.connect(self._on_candidates)
        self._reader.written.connect(self._on_written)
        self._reader.failed.connect(self._on_failure)
        self._candidates.candidatesMade.connect(lambda index, file: self._reader.read_candidates(index, Path(file)))
        self._candidates.failed.connect(self._on_no_candidates)
        self._candidates.prompted.connect(corrector.hear_masks)
        corrector.promptWanted.connect(self._on_prompt_wanted)
        corrector.changed.connect(self._on_painted)
        corrector.stepped.connect(self._on_stepped)
        corrector.moved.connect(page.canvas.update)
        corrector.sized.connect(lambda: page.show_brush(corrector.brush_share))
        corrector.waiting.connect(self._on_waiting)
        page.sizeChanged.connect(corrector.set_brush_share)
        page.gainChanged.connect(page.canvas.set_gain)
        page.keyed.connect(self._on_key)
        page.layers.changed.connect(self._on_layer)
        page.canvas.zoomChanged.connect(self._soon.start)

    # What the window asks ---------------------------------------------------------------------------------------

    @property
    def is_open(self) -> bool:
        """Whether the page is what the person sees."""
        return self.page.isVisible()

    def open(self, index: int) -> None:
        """Shows a frame, and stands in its camera in the 3D view."""
        capture = self._document.contents.capture
        if capture is None or not 0 <= index < len(capture.frames):
            return
        self._document.select(frame=index)
        self.opened.emit()
        self._take(index)
        self._scene.navigation.set_pose(cameras.seen_from_frame(capture.frames[index].camera))
        self.page.canvas.setFocus()

    def set_tool(self, tool: str) -> None:
        """One of TOOLS, or "" to look only."""
        self.tool = tool
        canvas = self.page.canvas
        canvas.tool = {"brush": self.corrector.brush, "points": self.corrector.points}.get(tool)
        canvas.unsetCursor()
        self.page.show_brush(self.corrector.brush_share if tool == "brush" else None)
        self._say_hint()
        if tool:
            self.page.layers.boxes["floor"].setChecked(True)
        if tool == "points":
            self._prepare_points()
        canvas.update()
        self.toolChanged.emit(tool)

    def _prepare_points(self) -> None:
        try:
            network = prompted_files() is not None
        except InputError as error:
            self._notices.warning(str(error))
            network = False
        self.corrector.use_network(network)
        if not network:
            self._want_candidates()

    def step(self, by: int) -> None:
        """So many frames on in the walk."""
        capture = self._document.contents.capture
        if self.index is not None and capture is not None:
            self.open((self.index + by) % len(capture.frames))

    def ask_render(self) -> None:
        """The channel or the renderer is another one."""
        self._soon.start()

    def release(self) -> None:
        """Keeps everything and ends thread and process; the page is not used afterwards."""
        self.corrector.close()
        self._reader.stop()
        self._candidates.rest()

    # The frame on the page --------------------------------------------------------------------------------------

    def _take(self, index: int) -> None:
        capture, path = self._document.contents.capture, self._document.path
        if capture is None or path is None or index == self.index:
            return
        self.corrector.close()
        self.index, self._asked_for = index, None
        self.page.canvas.note = "Reading the image…"
        self._reader.open(Layout(path), capture.frames[index], index)
        self._say_title()

    def _drop(self) -> None:
        """There is no frame to show."""
        self.corrector.close()
        self.index = self.matter = self._asked_for = None
        for layer in self.layers:
            layer.painted = None
        self._show_over_scene()
        self.page.canvas.show_photo(None, keep_zoom=False)
        if self.is_open:
            self.left.emit()

    def _on_matter(self, matter: Matter) -> None:
        path = self._document.path
        if matter.index != self.index or path is None:
            return
        again = self.matter is not None and self.matter.index == matter.index
        self.matter = matter
        self.corrector.open(Layout(path), matter)
        for layer in self.layers:
            layer.painted = None
        self._show_mask(matter)
        canvas = self.page.canvas
        canvas.render_note = "" if self._document.contents.scene_stamp is not None else _NO_MODEL
        canvas.show_photo(pictures.photo(matter.image), keep_zoom=again or canvas.zoom.scale > 0)
        self._say_title()
        self._say_hint()
        self._ask_render()
        if self.tool == "points":
            self._prepare_points()
        if any(self._layer[name].shown for name in CANDIDATES):
            self._want_candidates()
        self._show_over_scene()

    def _show_mask(self, matter: Matter) -> None:
        correction = self.corrector.correction
        if correction is not None:
            self._layer["floor"].painted = pictures.tint(correction.mask, self._layer["floor"].color)
        elif matter.mask is not None:
            self._layer["floor"].painted = pictures.tint(matter.mask, self._layer["floor"].color)
        if matter.machine is not None:
            self._layer["machine"].painted = pictures.tint(matter.machine, self._layer["machine"].color)

    def _show_over_scene(self) -> None:
        painted = self._layer["floor"].painted
        if self.matter is None or painted is None:
            self.over_scene.show(None, None)
        else:
            self.over_scene.show(self.matter.frame.camera, painted.image)
        self._scene.update()

    # The render -------------------------------------------------------------------------------------------------

    def _ask_render(self) -> None:
        if self.matter is None or not self.is_open or self._document.contents.scene_stamp is None:
            return
        canvas, camera = self.page.canvas, self.matter.frame.camera
        height, width = self.matter.image.shape[:2]
        found = canvas.panes()
        if not found:
            return
        # No finer than the screen shows it, no finer than the photo.
        scale = min(1.0, found[0].scale * canvas.devicePixelRatioF())
        size = max(1, round(width * scale)), max(1, round(height * scale))
        request = Request(
            next(self._numbers), camera.scaled(*size), self._scene.channel, False, self._scene.renderer, _VIEW
        )
        self._scene.link.ask(request)
        canvas.render_note = "" if self._scene.link.ready else "Loading the reconstruction…"

    def _on_picture(self, picture: Picture) -> None:
        matter, camera = self.matter, picture.request.camera
        if (
            picture.request.view == _VIEW
            and matter is not None
            and (
                camera.camera_to_world is matter.frame.camera_to_world
                or (camera.camera_to_world == matter.frame.camera_to_world).all()
            )
        ):
            self.page.canvas.show_render(pictures.render(picture.pixels))

    # The candidates ---------------------------------------------------------------------------------------------

    def _want_candidates(self) -> None:
        path = self._document.path
        if self.matter is None or path is None or self._asked_for == self.matter.index:
            return
        self._asked_for = self.matter.index
        self._candidates.open_if_other(path)
        self._candidates.ask_candidates(self.matter.index)
        self._say_hint()

    def _on_candidates(self, index: int, steps: HybridSteps) -> None:
        if index != self.index:
            return
        self._layer["normals"].painted = pictures.normals(steps.normals)
        for name in ("semantic", "horizontal", "prompted"):
            self._layer[name].painted = pictures.tint(getattr(steps, name), self._layer[name].color)
        self.corrector.hear_steps(steps)
        self._say_hint()
        self.page.canvas.update()

    def _on_no_candidates(self, what: str, index: int, sentence: str) -> None:
        self._notices.warning(sentence)
        if what == "prompt" or index == -1:
            self.corrector.hear_no_masks()
            self._want_candidates()
        if what != "prompt" and index in (self.index, -1):
            self.corrector.hear_steps(None)
        self._say_hint()

    def _on_prompt_wanted(self, index: int, points: list[tuple[float, float, bool]]) -> None:
        path = self._document.path
        if path is not None:
            self._candidates.open_if_other(path)
            self._candidates.ask_prompt(index, points)

    # Correcting -------------------------------------------------------------------------------------------------

    def _on_painted(self, box: Box) -> None:
        layer, correction = self._layer["floor"], self.corrector.correction
        if layer.painted is not None and correction is not None:
            pictures.retint(layer.painted, correction.mask, layer.color, box)
            self.page.canvas.refresh(box)

    def _on_stepped(self) -> None:
        correction = self.corrector.correction
        if correction is not None and self.index is not None:
            self._state.learn(self.index, correction.coverage, correction.is_corrected)
        self.page.canvas.update()
        self._scene.update()

    def _on_written(self, index: int) -> None:
        if self.index == index:
            self._say_hint()

    def _on_waiting(self, waiting: bool) -> None:
        self._waits = waiting
        self._say_hint()

    # Following the document -------------------------------------------------------------------------------------

    def _on_project(self) -> None:
        self.corrector.forget()
        self._drop()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if self.index is None:
            return
        capture = self._document.contents.capture
        if "capture" in parts and (capture is None or self.index >= len(capture.frames)):
            self._drop()
        elif parts & {"capture", "submaps"}:
            # The masks may be others now.
            index, self.index = self.index, None
            self._take(index)
        elif "scene_stamp" in parts:
            self._soon.start()

    def _on_selection(self) -> None:
        frame = self._document.selection.frame
        if frame is not None and (self.is_open or self.over_scene.shown):
            self._take(frame)

    def _on_layer(self, layer: FrameLayer) -> None:
        if layer.name in CANDIDATES and layer.shown and layer.painted is None:
            self._want_candidates()

    def _on_failure(self, failure: Failure) -> None:
        self._notices.error(failure.sentence)
        if failure.index == self.index and (self.matter is None or self.matter.index != self.index):
            self.matter = None
            self.page.canvas.note = failure.sentence
            self.page.canvas.show_photo(None, keep_zoom=False)

    def _on_key(self, name: str) -> None:
        actions = {
            "leave": lambda: self.set_tool("") if self.tool else self.left.emit(),
            "previous": lambda: self.step(-1),
            "next": lambda: self.step(1),
            "fit": lambda: self.page.canvas.set_zoom(type(self.page.canvas.zoom)()),
            "undo": self.corrector.undo,
            "redo": self.corrector.redo,
            "smaller": lambda: self.corrector.brush.grow(1 / 1.15),
            "larger": lambda: self.corrector.brush.grow(1.15),
        }
        actions[name]()

    # Words ------------------------------------------------------------------------------------------------------

    def _say_title(self) -> None:
        capture = self._document.contents.capture
        if self.index is None or capture is None or self.index >= len(capture.frames):
            return
        name = capture.frames[self.index].name
        where = f"frame {self.index + 1:,} of {len(capture.frames):,}"
        self.page.title.setText(f"<b>{name}</b>&nbsp;&nbsp; {where}, {coverage_words(self._state, self.index)}")

    def _say_hint(self) -> None:
        words = _HINTS[self.tool]
        matter = self.matter
        if self.tool and matter is not None and matter.machine is None:
            words = _NO_MASK
        elif self._asked_for is not None and self._layer["normals"].painted is None:
            words = "The candidate masks are being made; the first of a submap take a while…   " + words
        elif self._waits:
            words = "The prompted network is at work…   " + words
        self.page.hint.setText(words)
