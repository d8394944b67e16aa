"""Damaged or deleted results of a project are restored by the command that the message names."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, make_dataclass
from pathlib import Path

import numpy as np
import pytest
from capture_samples import room, walk, write_nerfstudio

from nvsim.errors import InputError
from nvsim.events import Event, ignore_event
from nvsim.project import ledger
from nvsim.project.config import CaptureConfig
from nvsim.project.corrections import corrections_key, save_correction
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, mapped, submaps
from nvsim.submaps.split import SubmapConfig


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("damaged")
    write_nerfstudio(folder, walk(6), room())
    with Project.create_or_open(folder / "house.nvsim") as made:
        imported.run(made, folder, CaptureConfig(), ignore_event)
        submaps.run(made, SubmapConfig(count=1), ignore_event)
        floors.run(made, ignore_event)
    return folder / "house.nvsim"


@pytest.mark.parametrize(
    ("part", "read", "sentence"),
    [
        ("floor/surface_000.npz", lambda p: p.surface(0), "nvsim floors"),
        ("floor/support.npz", lambda p: p.support(), "nvsim floors"),
        ("imported/capture.json", lambda p: p.capture(), "import the capture again"),
    ],
)
def test_a_truncated_part_is_told_and_made_again_as_it_was(
    project: Path, part: str, read: Callable[[Project], object], sentence: str
) -> None:
    with Project.open(project, writable=True) as opened:
        name, _, file = part.partition("/")
        path = opened.layout.in_use(name) / file
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(InputError, match=sentence):
            read(opened)
        imported.run(opened, project.parent, CaptureConfig(), ignore_event)
        floors.run(opened, ignore_event)
        assert read(opened) is not None
        assert ledger.is_current(opened, "floors", floors.floors_key(opened))


def test_a_mask_that_was_deleted_is_made_again(project: Path) -> None:
    with Project.open(project, writable=True) as opened:
        path = opened.layout.mask(2)
        before = path.read_bytes()
        path.unlink()
        floors.run(opened, ignore_event)
        assert opened.layout.mask(2).read_bytes() == before


def test_a_correction_that_is_a_folder_is_reported(project: Path) -> None:
    with Project.open(project, writable=True) as opened:
        frame = opened.need_capture().frames[1]
        path = opened.layout.correction(frame.name)
        path.mkdir(parents=True)
        with pytest.raises(InputError, match="it is a folder"):
            corrections_key(opened, range(6))
        path.rmdir()
        save_correction(opened.layout, frame, np.ones((48, 64), bool))
        assert corrections_key(opened, range(6))
        path.unlink()


def test_a_name_with_a_lone_surrogate_names_a_correction(project: Path) -> None:
    with Project.open(project) as opened:
        assert opened.layout.correction("a/\ud800.png").name.isascii()


def test_what_was_imported_before_frames_could_be_left_out_stays_current(project: Path) -> None:
    before = make_dataclass("CaptureConfig", [(n, object) for n in ("scale", "camera_height", "hold_out")])
    plain = CaptureConfig(camera_height=1.2)
    assert ledger.key_of("import", plain.key) == ledger.key_of("import", before(None, 1.2, 8))
    assert ledger.key_of("import", CaptureConfig(leave_out="a").key) != ledger.key_of("import", CaptureConfig().key)
    later = {"leave_out", "images", "axes", "model", "poses", "known_length", "views", "mask", "up", "clean"}
    later |= {"features", "people"}
    assert set(asdict(plain)) - set(plain.key["CaptureConfig"]) == later
    heard: list[Event] = []
    with Project.open(project, writable=True) as opened:
        imported.run(opened, project.parent, CaptureConfig(), heard.append)
    assert any("unchanged" in str(event) for event in heard)


@pytest.mark.timeout(20)
def test_evidence_is_not_read_from_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "evidence")
    assert mapped._evidence(tmp_path / "evidence") is None
