"""The dialog that creates a project from captures: their paths, the results of the data check, and the project path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from PySide6.QtCore import Qt, QTemporaryDir, QTimer, Signal
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QDialogButtonBox, QFileDialog, QGridLayout, QLineEdit, QProgressBar, QPushButton, QWidget

from nvsim.capture import formats
from nvsim.capture.excluded_frames import FROM_FILE, write_names
from nvsim.capture.multi_capture import SUFFIX, write_list
from nvsim.errors import InputError
from nvsim.files.user_folders import home_folder
from nvsim.project.config import CaptureConfig
from nvsim.reconstruction.pose_networks import NONE, Use, suitable_models
from nvsim_app.forms.fields import Field, fields_of
from nvsim_app.forms.rows import Editor, LineEditor, editor_of
from nvsim_app.jobs.queries import CaptureCheck, CheckResult
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import InkLabel, Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import Dialog, DialogButtons, Scrolling, named, push_button
from nvsim_app.panels.capture_check import CaptureFixes, CaptureSummary, FindingTree
from nvsim_app.state.recent_projects import place_for, problem_with

BETWEEN = "; "  # separates several captures in the line
NETWORKS: dict[Use, str] = {
    "features": "Network that finds and matches keypoints. It is used if it matches images better than SIFT.",
    "people": "Network that recognizes people. They are ignored in poses, depth, floor masks and training.",
}
TYPING = 500  # milliseconds after the last change until the check starts


@dataclass(frozen=True)
class NewProject:
    """The choices of the user.

    captures   captures in one world; usually one
    options    flags of `nvsim import`
    everything whether the other stages run too
    left_out   names of the frames that are not imported
    """

    captures: tuple[Path, ...]
    project: Path
    options: tuple[str, ...]
    everything: bool
    left_out: tuple[str, ...] = ()


class NewProjectDialog(Dialog):
    """Checks captures and starts their import. chosen(NewProject): the user started it.

    project     existing project to import into
    beside      captures that the project already has; the new ones are added to them and checked together with them
    understood  settings of the import of those captures, which also apply to the new ones
    """

    chosen = Signal(object)

    def __init__(
        self,
        captures: Sequence[Path] = (),
        project: Path | None = None,
        parent: QWidget | None = None,
        beside: Sequence[Path] = (),
        understood: CaptureConfig | None = None,
    ) -> None:
        super().__init__(parent)
        title = (
            "Add a capture"
            if beside
            else "New project from a capture or video"
            if project is None
            else "Import a capture"
        )
        self.setWindowTitle(title)
        self._beside = list(beside)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._fixed = project
        self._named = project is not None  # the user selected the path of the project
        self._images = "" if understood is None else understood.images  # the image folder
        self.left_out: tuple[str, ...] = ()
        self.result_shown: CheckResult | None = None
        self._scratch = QTemporaryDir()  # holds the list of several captures during their check
        self.check = CaptureCheck(self)
        self.check.finished.connect(self.show_result)
        self.check.failed.connect(self._on_failed)
        self._due = QTimer(self, singleShot=True, interval=TYPING)
        self._due.timeout.connect(self._start_check)
        self._options = {f.path.rpartition(".")[2]: f for f in fields_of("import")}
        for use, help in NETWORKS.items():
            names = [model.name for model in suitable_models(use)]
            earlier = "" if understood is None else getattr(understood, use)
            choices = tuple(dict.fromkeys((NONE, *names, earlier or NONE)))
            field = replace(self._options[use], kind="choice", choices=choices, default=NONE, help=help)
            self._options[use] = field
        self._build()
        if project is not None:
            self.project.setText(str(project))
        for name, editor in self._editors().items():
            if understood is not None:
                editor.show_value(getattr(understood, name))
                editor.setEnabled(False)
        if captures:
            self.set_captures(captures)
        self.resize(940, 620)
        self._show_state()

    def _build(self) -> None:
        self.capture = QLineEdit(self, placeholderText=f"{formats.names()}, or a video: a folder or a file")
        self.capture.setAccessibleName("Capture")
        folder, file = QPushButton("Folder…", self), QPushButton("File…", self)
        another = push_button(
            "Add…", self, self._browse_another, "Add another capture of the building, in the same world and unit"
        )
        folder.clicked.connect(self._browse_folder)
        file.clicked.connect(self._browse_file)
        self.project = named(QLineEdit(self, readOnly=self._fixed is not None), "Project")
        place = push_button("Browse…", self, self._browse_project, enabled=self._fixed is None)
        self.camera_height = self._line("camera_height")
        self.scale = self._line("scale")
        self.hold_out = self._line("hold_out")
        self.model = self._line("model")
        self.poses = self._editor("poses")
        self.axes = self._editor("axes")
        self.features, self.people = self._editor("features"), self._editor("people")
        grid = QGridLayout()
        grid.addWidget(Label("Capture", self), 0, 0)
        grid.addWidget(self.capture, 0, 1, 1, 2)
        grid.addWidget(folder, 0, 3)
        grid.addWidget(file, 0, 4)
        grid.addWidget(another, 0, 5)
        grid.addWidget(Label("Project", self), 1, 0)
        grid.addWidget(self.project, 1, 1, 1, 2)
        grid.addWidget(place, 1, 3, 1, 3)
        asked: tuple[tuple[str, Editor], ...]
        asked = ("Camera height", self.camera_height), ("Scale", self.scale), ("Held out", self.hold_out)
        asked += ("Axes", self.axes), ("Poses", self.poses), ("Model", self.model)
        asked += ("Features", self.features), ("People", self.people)
        self._rows: dict[str, list[QWidget]] = {}
        for row, (words, editor) in enumerate(asked, start=2):
            name = Label(words, self, toolTip=tooltip_text(editor.field.flag))
            help = Label(editor.field.help, self, wordWrap=True, quiet=True)
            grid.addWidget(name, row, 0)
            grid.addWidget(editor, row, 1)
            grid.addWidget(help, row, 2, 1, 4)
            self._rows[editor.field.path.rpartition(".")[2]] = [name, editor, help]
        grid.setColumnStretch(2, 1)
        self.verdict = Label(self, font=type_font(bold=True), wordWrap=True)
        self.busy = named(QProgressBar(self, textVisible=False), "Progress of the check")
        self.busy.setRange(0, 0)
        self.busy.setMaximumHeight(6)
        policy = self.busy.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.busy.setSizePolicy(policy)
        self.findings = FindingTree(self)
        self.findings.itemSelectionChanged.connect(self._show_state)
        self.summary = CaptureSummary(self)
        self.mending = CaptureFixes(self)
        self.mending.leaveOutWanted.connect(self._leave_out)
        self.mending.takeBackWanted.connect(lambda: self._exclude_frames(()))
        self.mending.folderWanted.connect(self._browse_images)
        self.mending.scaleWanted.connect(self._ask_height)
        self.mending.axesWanted.connect(self._read_as)
        self.problem = InkLabel("blocked", self)
        self.problem.setWordWrap(True)
        buttons = DialogButtons(self)
        verb = "Add" if self._beside else "Import"
        self.run_button = buttons.addButton(f"{verb} and run everything", QDialogButtonBox.ButtonRole.AcceptRole)
        self.import_button = buttons.addButton(f"{verb} only", QDialogButtonBox.ButtonRole.ActionRole)
        buttons.addButton(QDialogButtonBox.StandardButton.Cancel)
        self.run_button.clicked.connect(lambda: self._choose(everything=True))
        self.import_button.clicked.connect(lambda: self._choose(everything=False))
        buttons.rejected.connect(self.reject)
        page = QWidget(self)
        found = QGridLayout()
        found.setColumnStretch(0, 1)
        found.addWidget(self.findings, 0, 0)
        found.addWidget(self.mending, 1, 0)
        found.addWidget(self.summary, 0, 1, 2, 1)
        self.summary.setFixedWidth(250)
        vbox(grid, self.verdict, self.busy, (found, 1), on=page, margins=0)
        scrolled = Scrolling(page, self)  # so that the buttons are visible on a small screen
        vbox((scrolled, 1), self.problem, buttons, on=self)
        self.capture.textChanged.connect(self._on_capture)
        self.project.textEdited.connect(self._on_named)
        self.project.textChanged.connect(lambda _: self._show_state())

    def _editor(self, name: str) -> Editor:
        field: Field = self._options[name]
        editor = editor_of(field, self)
        editor.show_value(field.default)
        editor.changed.connect(self._on_option)
        return editor

    # Captures and options ---------------------------------------------------------------------------------------

    def set_captures(self, paths: Sequence[Path]) -> None:
        """Sets the captures and starts their check."""
        self.capture.setText(BETWEEN.join(str(p) for p in paths))

    def captures(self) -> list[Path]:
        """The captures in the line, in order."""
        words = [word.strip() for word in self.capture.text().split(BETWEEN.strip())]
        return [Path(word).expanduser().absolute() for word in words if word]

    def _on_capture(self, text: str) -> None:
        captures = self.captures()
        if not self._named and captures:
            self.project.setText(str(place_for(captures[0])))
        self.result_shown, self.left_out = None, ()
        if not self._beside:
            self._images = ""
            self.model.line.clear()
        self._due.start()
        self._show_state()

    def _on_named(self, _: str) -> None:
        self._named = True

    def _on_option(self) -> None:
        self._due.start()
        self._show_state()

    def _values(self) -> dict[str, float | int | None]:
        """The values of the options. Raises ValueError with a message for the user."""
        return {name: editor.value() for name, editor in self._editors().items()}

    def _line(self, name: str) -> LineEditor:
        editor = self._editor(name)
        assert isinstance(editor, LineEditor)
        return editor

    def _editors(self) -> dict[str, Editor]:
        lines = {"camera_height": self.camera_height, "scale": self.scale, "hold_out": self.hold_out}
        lists = {"axes": self.axes, "features": self.features, "people": self.people}
        return {**lines, **lists, "model": self.model, "poses": self.poses}

    def _start_check(self) -> None:
        captures = self.captures()
        if not captures:
            return
        captures = [*self._beside, *captures]
        try:
            values = self._values()
        except ValueError:
            return
        source = captures[0]
        if len(captures) > 1:
            source = Path(self._scratch.path()) / f"together{SUFFIX}"
            try:
                write_list(captures, source)
            except InputError as error:
                self._on_failed(str(error))
                return
        leave_out = Path(self._scratch.path()) / "left_out.txt"
        try:
            write_names(self.left_out, leave_out)
        except InputError as error:
            self._on_failed(str(error))
            return
        listed = f"{FROM_FILE}{leave_out}" if self.left_out else ""
        model = self.model.line.text().strip() if len(captures) == 1 else ""
        asked = values["scale"], values["camera_height"], listed, self._images, str(values["axes"]), model
        self.check.start(source, *asked)
        self._show_state()

    # Check ------------------------------------------------------------------------------------------------------

    def show_result(self, result: CheckResult) -> None:
        """Shows the result of the check."""
        self.result_shown = result
        self.findings.show_result(result)
        self.summary.show_summary(result.summary, len(result.bad_frames), len(self.left_out), result.videos)
        self._show_state()

    def _on_failed(self, sentence: str) -> None:
        self.findings.clear()
        self.summary.show_summary(None)
        self._show_state()
        self.verdict.setText(sentence)

    # Fixes ------------------------------------------------------------------------------------------------------

    def _leave_out(self, names: tuple[str, ...]) -> None:
        self._exclude_frames((*self.left_out, *names))

    def _exclude_frames(self, names: tuple[str, ...]) -> None:
        """Leaves out exactly these frames, and checks again."""
        self.left_out = tuple(dict.fromkeys(names))
        self._start_check()

    def _browse_images(self) -> None:
        chosen = QFileDialog.getExistingDirectory(self, "Select the folder of the images", self._start())
        if chosen:
            self.look_in(chosen)

    def look_in(self, folder: str) -> None:
        """Checks again with the images of this folder."""
        self._images = folder
        self._start_check()

    def _read_as(self, axes: str) -> None:
        """Reads the poses in this axis convention, and checks again."""
        self.axes.show_value(axes)
        self._on_option()

    def _ask_height(self) -> None:
        self.camera_height.line.setFocus()
        self.camera_height.line.selectAll()

    def _show_state(self) -> None:
        result = self.result_shown
        self.busy.setVisible(self.check.running)
        chooses_model = len(self.captures()) == 1 and not self._beside
        chooses_model &= bool(self.model.line.text().strip()) or (result is not None and result.has_models)
        takes_networks = result is not None and result.networks
        self._show_row("model", chooses_model)
        for use in NETWORKS:
            self._show_row(use, takes_networks and len(self._options[use].choices) > 1)
        if self.check.running or self._due.isActive():
            self.verdict.setText("Checking the capture: every image, pose and point…")
        elif result is not None:
            mended = " The buttons below the list can fix this." if result.refused and result.is_fixable else ""
            self.verdict.setText(f"{result.sentence}{mended}")
        elif not self.capture.text().strip():
            self.verdict.setText(
                "Select a capture or a video, or drop one on the window. NVSim checks it before the import starts."
            )
        problem = self._problem()
        self.problem.setText(problem)
        checking = self.check.running or self._due.isActive()
        self.mending.show_fixes(
            None if checking else result, self.findings.chosen, len(self.left_out), not self._beside
        )
        ready = result is not None and not result.refused and not result.needs_scale and not problem and not checking
        self.run_button.setEnabled(ready)
        self.import_button.setEnabled(ready)

    def _show_row(self, name: str, visible: bool) -> None:
        for widget in self._rows[name]:
            widget.setVisible(visible)

    def _problem(self) -> str:
        try:
            self._values()
        except ValueError as error:
            return str(error)
        text = self.project.text().strip()
        return problem_with(Path(text).expanduser()) if text and self._fixed is None else ""

    # Choosing ---------------------------------------------------------------------------------------------------

    def _choose(self, everything: bool) -> None:
        values = self._values()
        options: list[str] = []
        replaces = self._fixed is not None and not self._beside  # without an option, earlier networks would be kept
        for name, value in values.items():
            field = self._options[name]
            is_set = value != field.default or (replaces and name in NETWORKS)
            if is_set and not self._rows[name][0].isHidden():
                options += [field.flag, str(value)]
        if self._images and not self._beside:
            options += [self._options["images"].flag, self._images]
        project = Path(self.project.text().strip()).expanduser().absolute()
        self.chosen.emit(NewProject(tuple(self.captures()), project, tuple(options), everything, self.left_out))
        self.accept()

    def _browse_folder(self) -> None:
        chosen = QFileDialog.getExistingDirectory(self, "Select the folder of the capture", self._start())
        if chosen:
            self.set_captures([Path(chosen)])

    def _browse_another(self) -> None:
        chosen = QFileDialog.getExistingDirectory(self, "Select another capture in the same world", self._start())
        if chosen:
            self.set_captures([*self.captures(), Path(chosen)])

    def _browse_file(self) -> None:
        chosen, _ = QFileDialog.getOpenFileName(
            self, "Select a file of the capture", self._start(), f"Captures: {formats.names()} (*)"
        )
        if chosen:
            self.set_captures([Path(chosen)])

    def _browse_project(self) -> None:
        chosen, _ = QFileDialog.getSaveFileName(self, "New project", self.project.text(), "Projects (*.nvsim)")
        if chosen:
            self._named = True
            self.project.setText(chosen if chosen.endswith(".nvsim") else f"{chosen}.nvsim")

    def _start(self) -> str:
        captures = self.captures()
        return str(captures[-1].parent if captures else home_folder())

    def done(self, code: int) -> None:
        self._due.stop()
        self.check.stop()
        super().done(code)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._due.stop()
        self.check.stop()
        super().closeEvent(event)
