"""The controller of the frame page: shows the photo, render, masks, and candidates of a frame, and stores corrections
of its mask."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal

from nvsim.perception.hybrid import HybridSteps
from nvsim.perception.roles import FAILURE_WORDS
from nvsim.perception.roles import Failure as MaskFailure
from nvsim.project.project import layout_of
from nvsim.project.work import STAGE, sentence
from nvsim_app.frames import pictures
from nvsim_app.frames.canvas import Tool
from nvsim_app.frames.correction import Box
from nvsim_app.frames.corrector import Candidates, Corrector
from nvsim_app.frames.frame_data import Failure, FrameData, FrameRender, Reader
from nvsim_app.frames.layers import CANDIDATES, OF_DEPTH, OF_MASK, FrameLayer, standard_layers
from nvsim_app.frames.page import FramePage
from nvsim_app.frames.state import FrameState, frame_words
from nvsim_app.layers.capture import FrameMaskLayer
from nvsim_app.look.notices import Notices
from nvsim_app.look.plain_text import escape_html, plain
from nvsim_app.painting import cameras
from nvsim_app.state.document import Document
from nvsim_app.views.scene_view import SceneView

TOOLS = ("brush", "points")
_HINTS = {
    "": "Wheel: zoom; drag: move; double-click: fit; Page Up, Page Down: previous, next frame; Esc: close",
    "brush": "Left button paints floor, right button erases it; wheel or [ ]: size; Shift: straight line; "
    "Ctrl+wheel: zoom; Ctrl+Z: undo",
    "points": "Left button: the surface is floor; right button: it is not floor; wheel: zoom; middle drag: move; "
    "Ctrl+Z: undo",
}
_NO_MODEL = sentence(f"{STAGE['train'].missing}, so there is no render to compare with")
_NO_MASK = sentence(f"{STAGE['floors'].missing}; run “Find the floor” first")


class FrameBrowser(QObject):
    """Connects the frame page with the document, the renderer, and the mask correction.

    opened()           show the page
    taken()            the page shows another frame
    left()             leave the page
    toolChanged(str)   another tool is selected: one of TOOLS or ""
    """

    opened = Signal()
    taken = Signal()
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
        self.corrector = Corrector(self._reader, self)
        self.candidates = Candidates(self._reader, self.corrector, notices, self)
        self.render = FrameRender(scene, self)
        self.over_scene = FrameMaskLayer()
        scene.overlays.add(self.over_scene, below="graph")
        self.tool = ""
        self.index: int | None = None  # of the frame on the page
        self.matter: FrameData | None = None
        self._failure: MaskFailure = ""  # of the candidates
        self._connect()

    def _connect(self) -> None:
        document, page, corrector = self._document, self.page, self.corrector
        document.projectChanged.connect(self._on_project)
        document.contentsChanged.connect(self._on_contents)
        document.selectionChanged.connect(self._on_selection)
        self._scene.overlays.changed.connect(self._on_selection)
        self._state.changed.connect(self._say_title)
        self._reader.read.connect(self._on_matter)
        self._reader.written.connect(self._on_written)
        self._reader.failed.connect(self._on_failure)
        self.candidates.made.connect(self._on_candidates)
        self.candidates.changed.connect(self._say_hint)
        self.render.wanted.connect(self._ask_render)
        self.render.rendered.connect(page.canvas.show_render)
        corrector.changed.connect(self._on_painted)
        corrector.stepped.connect(self._on_stepped)
        corrector.moved.connect(page.canvas.update)
        corrector.sized.connect(lambda: page.show_brush(corrector.brush_share))
        page.sizeChanged.connect(corrector.set_brush_share)
        page.gainChanged.connect(page.canvas.set_gain)
        page.keyed.connect(self._on_key)
        page.layers.changed.connect(self._on_layer)
        page.canvas.zoomChanged.connect(self.render.schedule)
        page.canvas.modeChanged.connect(self.render.schedule)

    # Interface of the window ------------------------------------------------------------------------------------

    @property
    def is_open(self) -> bool:
        """Whether the page is visible."""
        return self.page.isVisible()

    def open(self, index: int) -> None:
        """Shows a frame, and moves the camera of the 3D view to the frame's camera."""
        capture = self._document.contents.capture
        if capture is None or not 0 <= index < len(capture.frames):
            return
        self._document.select(frame=index)
        self.opened.emit()
        self._open_frame(index)
        self._scene.navigation.set_pose(cameras.seen_from_frame(capture.frames[index].camera))
        self.page.canvas.setFocus()

    def set_tool(self, tool: str) -> None:
        """Selects a tool: one of TOOLS, or "" for none."""
        self.tool = tool
        canvas = self.page.canvas
        tools: dict[str, Tool] = {"brush": self.corrector.brush, "points": self.corrector.points}
        canvas.tool = tools.get(tool)
        canvas.unsetCursor()
        self.page.show_brush(self.corrector.brush_share if tool == "brush" else None)
        self._say_hint()
        if tool:
            self.page.layers.boxes["floor"].setChecked(True)
        if tool == "points":
            self.candidates.prepare_points()
        canvas.update()
        self.toolChanged.emit(tool)

    def step(self, by: int) -> None:
        """Moves by this number of frames along the trajectory; negative numbers move back."""
        capture = self._document.contents.capture
        if self.index is not None and capture is not None:
            self.open((self.index + by) % len(capture.frames))

    def step_out(self) -> None:
        """Deselects the tool. If no tool is selected, leaves the page."""
        if self.tool:
            self.set_tool("")
        else:
            self.left.emit()

    def release(self) -> None:
        """Writes pending corrections and ends the thread and the process. The page must not be used afterward."""
        self.corrector.close()
        self._reader.stop()
        self.candidates.link.stop_process()

    # The frame on the page --------------------------------------------------------------------------------------

    def _open_frame(self, index: int) -> None:
        capture, path = self._document.contents.capture, self._document.path
        if capture is None or path is None or index == self.index:
            return
        self.corrector.close()
        self.index, self._failure = index, ""
        self.taken.emit()
        self.candidates.open(path, index)
        self.page.canvas.note = "Reading the image…"
        self._reader.open(layout_of(path), capture.frames[index], index)
        self._say_title()

    def _clear_page(self) -> None:
        """Clears the page, because there is no frame to show."""
        self.corrector.close()
        self.candidates.open(None, None)
        self.index = self.matter = None
        for layer in self.layers:
            layer.painted = None
        self._show_over_scene()
        self.page.canvas.show_photo(None, keep_zoom=False)
        if self.is_open:
            self.left.emit()

    def _on_matter(self, matter: FrameData) -> None:
        path = self._document.path
        if matter.index != self.index or path is None:
            return
        again = self.matter is not None and self.matter.index == matter.index
        self.matter = matter
        self.corrector.open(layout_of(path), matter)
        for layer in self.layers:
            layer.painted = None
        self._show_mask(matter)
        self.page.layers.show_optional(OF_DEPTH, matter.depth is not None)
        self.page.layers.show_optional(OF_MASK, matter.ignored is not None)
        if matter.ignored is not None:
            self._layer["ignored"].painted = pictures.tint(matter.ignored, self._layer["ignored"].color)
        if matter.depth is not None and matter.views is not None:
            self._layer["depth"].painted = pictures.depth(matter.depth)
            self._layer["views"].painted = pictures.confidence(matter.views)
        canvas = self.page.canvas
        canvas.render_note = "" if self._document.contents.scene_stamp is not None else _NO_MODEL
        canvas.show_photo(pictures.photo(matter.image), keep_zoom=again or canvas.zoom.scale > 0)
        self._say_title()
        self._say_hint()
        self._ask_render()
        if self.tool == "points":
            self.candidates.prepare_points()
        if any(self._layer[name].shown for name in CANDIDATES):
            self.candidates.request_once()
        self._show_over_scene()

    def _show_mask(self, matter: FrameData) -> None:
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
        canvas, found = self.page.canvas, self.page.canvas.panes()
        if self.matter is None or not self.is_open or not found or self._document.contents.scene_stamp is None:
            return
        # A difference compares colors, regardless of the channel of the 3D view.
        channel = "rgb" if canvas.mode == "difference" else self._scene.feed.channel
        self.render.ask(self.matter, found[0].scale * canvas.devicePixelRatioF(), channel)
        canvas.render_note = "" if self._scene.link.ready else self._scene.feed.note

    # The candidates ---------------------------------------------------------------------------------------------

    def _on_candidates(self, steps: HybridSteps) -> None:
        self._failure = steps.failure
        self._say_hint()
        self._layer["normals"].painted = pictures.normals(steps.normals)
        for name in ("semantic", "horizontal", "prompted"):
            self._layer[name].painted = pictures.tint(getattr(steps, name), self._layer[name].color)
        self.page.canvas.update()

    # Correcting -------------------------------------------------------------------------------------------------

    def _on_painted(self, box: Box) -> None:
        layer, correction = self._layer["floor"], self.corrector.correction
        if layer.painted is not None and correction is not None:
            pictures.repaint_mask(layer.painted, correction.mask, layer.color, box)
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

    # Following the document -------------------------------------------------------------------------------------

    def _on_project(self) -> None:
        self.corrector.reset()
        self._clear_page()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if self.index is None:
            return
        capture = self._document.contents.capture
        if "capture" in parts and (capture is None or self.index >= len(capture.frames)):
            self._clear_page()
        elif parts & {"capture", "submaps"}:
            # The masks may have changed.
            index, self.index = self.index, None
            self._open_frame(index)
        elif "scene_stamp" in parts:
            self.render.schedule()

    def _on_selection(self) -> None:
        frame = self._document.selection.frame
        if frame is not None and (self.is_open or self.over_scene.shown):
            self._open_frame(frame)

    def _on_layer(self, layer: FrameLayer) -> None:
        if layer.name in CANDIDATES and layer.shown and layer.painted is None:
            self.candidates.request_once()

    def _on_failure(self, failure: Failure) -> None:
        self._notices.error(failure.sentence)
        if failure.index == self.index and (self.matter is None or self.matter.index != self.index):
            self.matter = None
            self.page.canvas.note = failure.sentence
            self.page.canvas.show_photo(None, keep_zoom=False)

    def _on_key(self, name: str) -> None:
        actions = {
            "leave": self.step_out,
            "previous": lambda: self.step(-1),
            "next": lambda: self.step(1),
            "fit": lambda: self.page.canvas.set_zoom(type(self.page.canvas.zoom)()),
            "undo": self.corrector.undo,
            "redo": self.corrector.redo,
            "smaller": lambda: self.corrector.brush.grow(1 / 1.15),
            "larger": lambda: self.corrector.brush.grow(1.15),
        }
        actions[name]()

    # Text -------------------------------------------------------------------------------------------------------

    def _say_title(self) -> None:
        capture = self._document.contents.capture
        if self.index is None or capture is None or self.index >= len(capture.frames):
            return
        name = capture.frames[self.index].name
        where = f"frame {self.index + 1:,} of {len(capture.frames):,}"
        self.page.title.setText(
            f"<b>{escape_html(plain(name))}</b>&nbsp;&nbsp; {where}, {frame_words(self._state, self.index)}"
        )

    def _say_hint(self) -> None:
        words = _HINTS[self.tool]
        matter = self.matter
        if self.tool and matter is not None and matter.machine is None:
            words = _NO_MASK
        elif self.candidates.note:
            words = f"{self.candidates.note}   {words}"
        elif failure := self._failed():
            words = f"{failure}   {words}"
        self.page.hint.setText(words)

    def _failed(self) -> str:
        """A sentence that says why the mask or the candidates of this frame may be wrong; "" if there is no reason."""
        machine = self.matter.failure if self.matter is not None else ""
        if machine:
            return sentence(FAILURE_WORDS[machine])
        return sentence(f"candidates: {FAILURE_WORDS[self._failure]}") if self._failure else ""
