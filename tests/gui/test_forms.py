"""Forms show the words of the command line, and return its options."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QLabel, QPushButton
from pytestqt.qtbot import QtBot

from nvsim.cli.arguments import parse
from nvsim.cli.options import command_of, field_docs
from nvsim.training.config import TrainingConfig, preset
from nvsim_app.forms.fields import Field, Settings, arguments_of, fields_of, paper_values, presets_of, unit_of, validate
from nvsim_app.forms.form import CommandForm
from nvsim_app.forms.rows import OptionRow, number_text

PROJECT = Path("house.nvsim")
VERBS = (
    "submaps", "depth", "floors", "train", "map", "evaluate views", "evaluate floor", "evaluate depth",
    "evaluate graph", "evaluate calibration", "evaluate ablation", "evaluate validity-table",
    "export r2r", "export scan", "export features", "export splats",
)  # fmt: skip


def other(field: Field) -> Any:
    """A value that is not the default."""
    if field.kind == "switch":
        return not field.default
    if field.kind == "choice":
        return next(c for c in field.choices if c != field.default)
    if field.kind == "several" and len(field.default or ()) > 1:
        return tuple(field.default[1:])
    if field.kind == "several":
        return tuple(field.choices[:1]) if field.choices else ((2, 1) if field.item is int else ("nvsim",))
    if field.kind == "count":
        return (field.default or 3) + 1
    if field.kind == "number":
        return (field.default or 0.5) * 1.01
    return "some/where"


def value_at(arguments: Any, path: str) -> Any:
    for name in path.split("."):
        arguments = getattr(arguments, name)
    return arguments


@pytest.mark.parametrize("verb", VERBS)
def test_every_option_comes_back_from_the_command_line_as_it_was_given(verb: str) -> None:
    fields = fields_of(verb)
    alone = {"config.background", "config.appearance.embedding"}  # these make no sense without others
    tried = [f for f in fields if f.path not in alone]
    for first in range(0, len(tried), 10):
        chosen = tried[first : first + 10]
        words = arguments_of(fields, {f.path: other(f) for f in chosen})
        parsed = parse(command_of(verb), ["--project", str(PROJECT), *words], verb)
        for field in chosen:
            got = value_at(parsed, field.path)
            assert (str(got) if field.kind == "path" else got) == other(field), field.flag


def test_no_option_of_the_training_is_missing_from_its_form() -> None:
    def leaves(values: dict[str, Any], prefix: str) -> set[str]:
        found: set[str] = set()
        for name, value in values.items():
            found |= leaves(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}"}
        return found

    shown = {f.path for f in fields_of("train") if f.path.startswith("config.")}
    assert shown == leaves(asdict(TrainingConfig()), "config.") - {"config.name"}


def test_the_defaults_are_the_presets_and_the_papers_stand_beside_them() -> None:
    assert "3dgs" in presets_of("train")
    of_3dgs = {f.path: f.default for f in fields_of("train", "3dgs")}
    assert of_3dgs["config.sh_degree"] == preset("3dgs").sh_degree == 3
    assert paper_values("train")["config.loss.fill"] == 0.0
    assert paper_values("map")["config.rule"] == "mean"


@pytest.mark.parametrize(
    ("help", "unit"),
    [
        ("Metres of every step.", "m"),
        ("Meters of every step.", "m"),
        ("Radius of the robot in meters.", "m"),
        ("Radius of the robot in metres, for the map.", "m"),
        ("Settling: meters of the longest edge.", "m"),
        ("Meters. If floor is farther than this, a viewpoint is proposed.", "m"),
        ("delta, meters: a frame this close also belongs to the submap.", "m"),
        ("Meters per unit of the capture.", "m per unit"),
        ("Metres per unit of the capture.", "m per unit"),
        ("Area in square meters, 250 to 20000.", ""),
        ("Area in square metres.", ""),
        ("Covariance in square meters: the paper's 5e5 at 5 m a unit.", ""),
        ("GeoJSON: latitude of the origin in degrees. Without it, coordinates are in local meters.", "°"),
        ("Number of directions. The floor is searched in meters.", ""),
        ("Weight of the standard deviation in meters.", ""),
        ("Cost of a change of plane between two pixels.", ""),
        ("", ""),
    ],
)
def test_unit_is_the_one_in_the_first_sentence(help: str, unit: str) -> None:
    assert unit_of("x", help, "number") == unit


def test_help_and_units_come_from_the_dataclasses() -> None:
    docs = field_docs(TrainingConfig)
    assert docs["image_size"] == "Longest side of the training images, pixels."
    units = {f.path: f.unit for f in fields_of("train") + fields_of("map")}
    assert units["config.image_size"] == "px" and units["config.tau_dist"] == "m"
    assert units["config.lattice_offset"] == "°" and units["config.loss.ssim"] == ""


def test_help_has_quotation_marks_in_place_of_backquotes(qtbot: QtBot) -> None:
    fields = {field.path: field for verb in ("train", "export features") for field in fields_of(verb)}
    for path, words in (("cluster.executor", "needs the extra “cluster”"), ("out", "Default: “features”")):
        row = OptionRow(fields[path])
        qtbot.addWidget(row)
        texts = [label.text() for label in row.findChildren(QLabel)]
        assert any(words in text for text in texts) and not any("`" in text for text in texts)


def test_settings_keep_only_what_was_changed(tmp_path: Path) -> None:
    settings = Settings(tmp_path)
    settings.keep("train", "3dgs", {"config.steps": 500, "config.loss.ssim": 0.3})
    settings.keep("map", "nvsim", {})
    stored = json.loads((tmp_path / "settings.json").read_text())
    assert stored == {"train": {"preset": "3dgs", "config.steps": 500, "config.loss.ssim": 0.3}}
    again = Settings(tmp_path)
    assert again.arguments("train") == ["--preset", "3dgs", "--steps", "500", "--loss.ssim", "0.3"]
    assert again.arguments("map") == []


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"train": 3}',
        '{"train": {"config.steps": "many", "config.colour": 1, "preset": "none"}}',
        '{"train": {"config.steps": NaN, "config.loss.ssim": 1' + 400 * "0" + "}}",
    ],
)
def test_a_damaged_settings_file_is_ignored(tmp_path: Path, text: str) -> None:
    (tmp_path / "settings.json").write_text(text)
    assert Settings(tmp_path).arguments("train") == []


def test_a_value_that_makes_no_sense_is_refused_before_anything_starts() -> None:
    assert "steps must be at least 1" in validate("train", PROJECT, ["--steps", "0"])
    assert "--colour" in validate("train", PROJECT, ["--colour", "red"])
    assert validate("train", PROJECT, ["--steps", "10"]) == ""


@pytest.fixture
def form(qtbot: QtBot, tmp_path: Path) -> CommandForm:
    made = CommandForm("train", "Train", tmp_path, Settings(tmp_path))
    made.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)  # the fixture deletes it
    qtbot.addWidget(made)
    made.show()
    made.finish_building()
    return made


def test_a_changed_value_is_marked_shown_in_the_command_and_reset(qtbot: QtBot, form: CommandForm) -> None:
    row = form.rows["config.steps"]
    assert not row.reset_button.isVisible()
    row.editor.line.clear()
    qtbot.keyClicks(row.editor.line, "750")
    qtbot.waitUntil(lambda: form.command.text().endswith("--steps 750"))
    assert row._name.font().bold() and "default 2000" in row._origin.text()
    qtbot.mouseClick(row.reset_button, Qt.MouseButton.LeftButton)
    assert form.arguments() == [] and not row._name.font().bold()
    form.reject()


def test_what_is_no_number_is_named_and_cannot_be_started(qtbot: QtBot, form: CommandForm) -> None:
    line = form.rows["config.loss.ssim"].editor.line
    line.setText("a fifth")
    qtbot.waitUntil(lambda: not form.start_button.isEnabled())
    assert "SSIM is “a fifth”, which is not a number" in form.problem.text()
    line.setText("0,25")
    qtbot.waitUntil(form.start_button.isEnabled)
    assert form.arguments() == ["--loss.ssim", "0.25"]
    form.rows["config.steps"].editor.line.setText("0")
    qtbot.waitUntil(lambda: "steps must be at least 1" in form.problem.text())
    form.reject()


def test_another_preset_changes_the_defaults(qtbot: QtBot, form: CommandForm) -> None:
    form.presets.setCurrentText("splatfacto-i")
    assert form.rows["config.loss.fill"].editor.value() == 0.0
    assert form.arguments() == ["--preset", "splatfacto-i"]
    form.reject()


def test_a_form_opens_with_the_stored_preset(qtbot: QtBot, tmp_path: Path) -> None:
    settings = Settings(tmp_path)
    settings.keep("train", "splatfacto-i", {})
    again = CommandForm("train", "Train", tmp_path, settings)
    qtbot.addWidget(again)
    assert again.presets.currentText() == "splatfacto-i" != presets_of("train")[0]


def test_a_setting_is_found_by_its_words(qtbot: QtBot, form: CommandForm) -> None:
    qtbot.keyClicks(form.search, "floor texture learned")
    shown = [path for path, row in form.rows.items() if row.isVisible()]
    assert shown == ["config.texture"]
    form.reject()


def test_starting_keeps_the_settings_and_gives_the_flags(qtbot: QtBot, form: CommandForm, tmp_path: Path) -> None:
    form.rows["submaps"].editor.line.setText("0 2")
    form.rows["config.texture"].editor.box.setChecked(False)
    with qtbot.waitSignal(form.started) as started:
        qtbot.mouseClick(form.start_button, Qt.MouseButton.LeftButton)
    assert started.args[0] == ["--submaps", "0", "2", "--no-texture"]
    assert Settings(tmp_path).changed("train") == {"submaps": (0, 2), "config.texture": False}


def test_the_command_is_copied_as_it_stands(qtbot: QtBot, form: CommandForm, tmp_path: Path) -> None:
    copy = next(b for b in form.findChildren(QPushButton) if b.text() == "Copy")
    qtbot.mouseClick(copy, Qt.MouseButton.LeftButton)
    assert QGuiApplication.clipboard().text() == f"nvsim train --project {tmp_path}"
    form.reject()


@pytest.mark.parametrize(("value", "text"), [(5e-5, "5e-05"), (0.1, "0.1"), (20000.0, "20000"), (1 / 3, repr(1 / 3))])
def test_numbers_keep_every_digit(value: float, text: str) -> None:
    assert number_text(value) == text and float(text) == value


@pytest.mark.parametrize("verb", [verb for verb in VERBS if not verb.startswith("export")])  # these need a folder
def test_an_unchanged_form_can_be_started(verb: str, qtbot: QtBot, tmp_path: Path) -> None:
    form = CommandForm(verb, verb, PROJECT, Settings(tmp_path))
    qtbot.addWidget(form)
    form.finish_building()
    assert form.changed() == {}, "what is left out by default is no change"
