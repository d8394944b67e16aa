"""Faults that damaged inputs brought to light, each with its right outcome."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from nvsim.capture.moved_files import FolderFiles
from nvsim.errors import InputError, value_text
from nvsim.events import from_json
from nvsim.files.images import image_size_of
from nvsim.graph.arguments import Argument, check_arguments
from nvsim.graph.edits import EditError
from nvsim.project.state import results
from nvsim.project.state.cuts import load_cut, save_cut
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.observations.record import FinishedPart, ScanRecord
from nvsim.submaps.split import Submap


@pytest.mark.parametrize("text", ["\x1b[2J", "a\nb", "\u202e", "\ud800", "\0"])
def test_what_cannot_be_printed_is_escaped_in_every_sentence(text: str) -> None:
    for sentence in (str(InputError(f"There is no {text}.")), str(EditError(f"There is no {text}.")), value_text(text)):
        assert sentence.isprintable() and "\\" in sentence


def test_an_endless_name_keeps_its_beginning_and_the_advice() -> None:
    sentence = str(InputError(f"/a/b.txt names camera {'x' * 100_000}; repair it."))
    assert sentence.startswith("/a/b.txt names camera xxx") and sentence.endswith("xxx; repair it.")
    assert len(sentence) < 400


def test_an_endless_sentence_keeps_its_beginning_and_the_advice() -> None:
    sentence = str(InputError(f"/a/b.txt names {'camera and ' * 10_000} nothing; repair it."))
    assert sentence.startswith("/a/b.txt names camera") and sentence.endswith("nothing; repair it.")
    assert len(sentence) <= 4000


def test_a_path_of_usual_length_stays_whole() -> None:
    path = "/home/a user/" + "/".join(f"folder {i} of many" for i in range(30)) + "/capture.json"
    assert path in str(InputError(f"Cannot read {path}."))


def test_an_unknown_argument_of_an_edit_is_named() -> None:
    arguments = (Argument("ids", "names", "the viewpoints"),)
    with pytest.raises(EditError, match=r"remove has no argument 'other'; it takes ids\."):
        check_arguments("remove", arguments, {"other": 1})


def test_an_event_with_an_unknown_field_is_refused_in_one_line() -> None:
    with pytest.raises(ValueError) as caught:
        from_json('{"event": "metric", "stage": "train", "name": "psnr", "value": 1, "\\r\\n": 2}')
    assert str(caught.value).isprintable()


def test_a_deeply_nested_line_of_a_journal_is_no_line(tmp_path: Path) -> None:
    places = ScanPlaces(tmp_path, "house")
    places.journal.parent.mkdir(parents=True)
    places.journal.write_text('{"a":' * 100_000 + "\n")
    assert not ScanRecord(places).parts


def test_a_cut_at_an_absurd_place_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "1.npz"
    save_cut(path, [Submap(0, (0, 1), (0, 1), np.array([[0.0, 0, 0], [0, 0, 1e300]]))], ["a", "b"])
    with pytest.raises(InputError, match="its rows and positions do not match"):
        load_cut(path)


@pytest.mark.parametrize("figures", ['{"a": 1 "b"}', "[1]", "[" * 99_999])
def test_a_damaged_summary_of_a_stage_names_the_database(figures: str) -> None:
    with pytest.raises(InputError, match="is damaged"):
        _ = results.StagePart("k", 1.0, 1.0, figures).summary


def test_a_file_whose_name_holds_nul_is_not_looked_for(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch()
    found = FolderFiles(tmp_path).relocate([tmp_path / "x" / "a\0.png", tmp_path / "x" / "a.png"], [Path("\0")])
    assert list(found.found) == [tmp_path / "x" / "a.png"]


def test_an_image_header_without_pixels_has_no_size() -> None:
    image = cv2.imencode(".png", np.zeros((2, 3, 3), np.uint8))[1].tobytes()
    found = image_size_of(image)
    assert found is not None and (found.width, found.height) == (3, 2)
    assert image_size_of(image[:16] + bytes(8) + image[24:]) is None


def test_a_file_of_a_journal_whose_name_cannot_be_encoded_is_missing(tmp_path: Path) -> None:
    part = FinishedPart("key", {"\ud800.jpg": (1, "0" * 64)})
    assert not part.is_there(tmp_path)
