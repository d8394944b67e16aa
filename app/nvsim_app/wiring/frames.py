"""The frames of the capture: their list, and a page that compares a frame with its render and corrects its floor
mask."""

from __future__ import annotations

from PySide6.QtCore import QSettings

from nvsim_app.actions import Action
from nvsim_app.frames.browser import TOOLS, FrameBrowser
from nvsim_app.frames.canvas import MODES
from nvsim_app.frames.link import FrameLink
from nvsim_app.frames.state import FrameState, newest_scores
from nvsim_app.painting.value_colors import CHANNELS
from nvsim_app.panels.frames import FramePanel
from nvsim_app.panels.help import open_help
from nvsim_app.state.reasons import with_frame, with_frame_page, with_masks, with_trajectory
from nvsim_app.state.results import EvaluationResult
from nvsim_app.state.view_states import PageState
from nvsim_app.wiring.panels import ResultPart
from nvsim_app.wiring.part import Dock, Part, WindowContext

_MENU = "F&rame"
_MODES = {
    "photo": ("&Photo", "Show only the photo of the frame"),
    "render": ("&Render", "Show only the render from the frame's camera"),
    "wipe": ("&Wipe", "Photo on the left of a line that can be dragged, render on the right"),
    "blink": ("&Blink", "Alternate between photo and render"),
    "difference": ("&Difference", "Show the difference between render and photo; bright means large"),
    "beside": ("&Side by side", "Show photo and render side by side, at one zoom"),
}
_SHORT = {
    "leave_frame": "‹ 3D view",
    "frame_beside": "Compare",
    "mask_brush": "Brush",
    "mask_points": "Points",
    "mask_undo": "Undo",
    "mask_redo": "Redo",
    "mask_revert": "Revert",
    "mask_candidate": "Hybrid",
}
"""Labels of the buttons on the page."""


class FramePart(Part):
    """Shows the list of frames and the frame page, and corrects masks."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        document = context.document
        self._link = FrameLink(self)
        self.state = FrameState(document, self._link, self)
        self.panel = FramePanel(document, self._link, self.state)
        self.browser = FrameBrowser(document, context.scene, self.state, context.notices, self)
        self.panel.opened.connect(self.browser.open)
        context.window.center.addWidget(self.browser.page)
        self.browser.opened.connect(lambda: context.window.show_page(self.browser.page))
        self.browser.left.connect(self._close_page)
        self.browser.taken.connect(self._tell_page)
        context.window.center.currentChanged.connect(self._tell_page)
        self.browser.toolChanged.connect(self._show_tool)

    def docks(self) -> tuple[Dock, ...]:
        return (
            Dock("frames", "Frames", self.panel, "left", height=350, needs=with_trajectory,
                 workspaces=("explore", "train", "compare")),
        )  # fmt: skip

    def restore(self, settings: QSettings) -> None:
        table = self.context.window.actions_table
        for name, words in _SHORT.items():
            table[name].setIconText(words)
        self.browser.page.fill(
            [table["leave_frame"]],
            [table[f"frame_{mode}"] for mode in MODES],
            [
                *(table[f"mask_{tool}"] for tool in TOOLS),
                None,
                *(table[f"mask_{name}"] for name in ("undo", "redo", "revert", "candidate")),
            ],
        )
        self.context.part(ResultPart).gathered.connect(self._on_results)
        for channel in CHANNELS:
            table[channel].triggered.connect(self.browser.render.schedule)
        self.browser.page.layers.remember(str(settings.value("frame/layers", "")))
        mode = settings.value("frame/mode", "wipe")
        if mode in MODES:
            table[f"frame_{mode}"].setChecked(True)
            self.browser.page.show_mode(str(mode))

    def store(self, settings: QSettings) -> None:
        settings.setValue("frame/mode", self.browser.page.canvas.mode)
        settings.setValue("frame/layers", self.browser.page.layers.state)
        self.browser.release()
        self._link.open(None)

    # State of the page ------------------------------------------------------------------------------------------

    @property
    def shown(self) -> PageState:
        """The open frame, and how frames are compared."""
        browser, page = self.browser, self.browser.page
        is_open = self.context.window.center.currentWidget() is page
        layers = {layer.name: (layer.shown, round(layer.opacity, 2)) for layer in browser.layers}
        return PageState(browser.index if is_open else None, page.canvas.mode, layers)

    def show(self, state: PageState) -> None:
        """Restores a state that `shown` returned."""
        page = self.browser.page
        self.context.window.actions_table[f"frame_{state.mode}"].setChecked(True)
        page.show_mode(state.mode)
        for name, (on, opacity) in state.layers.items():
            page.layers.boxes[name].setChecked(on)
            page.layers.sliders[name].setValue(round(100 * opacity))
        now = self.shown.frame
        if state.frame is not None and state.frame != now:
            self.browser.open(state.frame)
        elif state.frame is None and now is not None:
            self._close_page()

    def _on_results(self, results: list[EvaluationResult]) -> None:
        self.state.show_scores(newest_scores(results))

    def _open(self) -> None:
        frame = self.context.document.frame_at_hand
        if frame is not None:
            self.browser.open(frame)

    def _tell_page(self, _: int = 0) -> None:
        is_open = self.context.window.center.currentWidget() is self.browser.page
        self.context.document.set_page_frame(self.browser.index if is_open else None)

    def _close_page(self) -> None:
        self.browser.corrector.flush()
        self.context.window.show_page(None)
        self.context.scene.setFocus()

    def _compare(self, mode: str) -> None:
        self.browser.page.show_mode(mode)
        if not self.browser.is_open:
            self._open()

    def _take_tool(self, tool: str, on: bool) -> None:
        if on and not self.browser.is_open:
            self._open()
        if on or self.browser.tool == tool:
            self.browser.set_tool(tool if on else "")

    def _show_tool(self, tool: str) -> None:
        for name in TOOLS:
            self.context.window.actions_table[f"mask_{name}"].setChecked(name == tool)

    ACTIONS = (
        Action(_MENU, 0, "open_frame", "&Compare with render",
               "Show the selected frame beside the render from its camera", _open, "Shift+F", with_frame,
               icon="compare", toolbar=True),
        Action(_MENU, 0, "leave_frame", "Back to the &3D view", "Close the frame, like Esc", _close_page,
               enabled=with_frame_page),
        *(
            Action(_MENU, 1, f"frame_{mode}", *_MODES[mode], lambda self, mode=mode: self._compare(mode),
                   f"Ctrl+{number}", with_frame, check="on" if mode == "wipe" else "off", group="frame_mode")
            for number, mode in enumerate(MODES, 1)
        ),
        Action(_MENU, 2, "mask_brush", "Correct with &brush",
               "Paint floor in the mask or erase it; training uses the result",
               lambda self, on: self._take_tool("brush", on), "Ctrl+B", with_masks, check="off"),
        Action(_MENU, 2, "mask_points", "Correct with p&oints",
               "Click surfaces that are floor; right-click surfaces that are not",
               lambda self, on: self._take_tool("points", on), "Ctrl+Shift+B", with_masks, check="off"),
        Action(_MENU, 3, "mask_undo", "&Undo correction", "Undo the last change of the mask (Ctrl+Z)",
               lambda self: self.browser.corrector.undo(), enabled=with_masks),
        Action(_MENU, 3, "mask_redo", "Re&do correction", "Redo the undone change of the mask (Ctrl+Y)",
               lambda self: self.browser.corrector.redo(), enabled=with_masks),
        Action(_MENU, 3, "mask_revert", "Re&vert mask", "Restore the mask of the floors stage",
               lambda self: self.browser.corrector.revert(), enabled=with_masks),
        Action(_MENU, 3, "mask_candidate", "Use &hybrid mask",
               "Use the mask grown from prompts, the last step of the hybrid segmentation, as the floor mask",
               lambda self: self.browser.corrector.take_candidate("prompted"), enabled=with_masks),
        Action("&Help", 1, "help_frames", "Frames and &masks",
               "How frames are compared with renders, and how their floor masks are corrected",
               lambda self: open_help("frames", self.context.window)),
    )  # fmt: skip
