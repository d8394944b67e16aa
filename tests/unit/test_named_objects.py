"""Objects that a semantic network names: from its classes to the words of instructions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from boxed_scan import RED, Block, export_blocks, flat_house
from described_models import described
from floor_networks import mmseg, segformer

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.networks.folder import VARIABLE
from nvsim.perception.semantic_network import SemanticNetwork
from nvsim.r2r.instructions.cues import Cue, cues_along
from nvsim.r2r.instructions.generating import with_one_name_each
from nvsim.r2r.instructions.ground import Leg
from nvsim.r2r.instructions.phrases import plain_name
from nvsim.r2r.surroundings.layers import layers_of
from nvsim.r2r.surroundings.survey import surroundings_of
from nvsim.r2r.surroundings.visibility import views_from_viewpoints

BED = 7
BLANKET, PURE_RED = (100, 100, 104), (220, 5, 5)
LOW_BED = Block((0.15, 2.9, 0), (1.0, 4.6, 0.5), BLANKET)


@pytest.mark.parametrize("classes", [150, 151])
def test_a_class_becomes_the_number_of_its_name(tmp_path: Path, classes: int) -> None:
    red = BED + classes - 150
    network = SemanticNetwork(described("segformer-ade20k", segformer(tmp_path / "n.onnx", classes, red=red)))
    image = np.tile(np.array((0, 0, 200), np.uint8), (90, 150, 1))
    image[40:, 60:] = PURE_RED
    found = network.objects(image)
    assert found.shape == (90, 150)
    assert [network.object_names[n - 1] for n in np.unique(found[44:, 64:])] == ["bed"]
    assert not found[:36].any() and not found[:, :56].any()


def test_a_label_becomes_the_number_of_its_name(tmp_path: Path) -> None:
    network = SemanticNetwork(described("mmseg-ade20k", mmseg(tmp_path / "n.onnx")))
    image = np.tile(np.array((0, 0, 200), np.uint8), (90, 150, 1))
    image[40:, 60:] = (10, 200, 10)  # a rug
    assert not network.objects(image).any()
    network._result = replace(network._result, objects=(("chair", (19,)), ("mat", (28,))))
    assert (network.objects(image) == 2).sum() == 50 * 90


def test_a_network_without_objects_is_refused(tmp_path: Path) -> None:
    network = SemanticNetwork(described("mmseg-ade20k", mmseg(tmp_path / "n.onnx")))
    network._result = replace(network._result, objects=())
    with pytest.raises(InputError, match="names no objects; use another network"):
        network.objects(np.zeros((90, 150, 3), np.uint8))


def by_color(face: np.ndarray) -> np.ndarray:
    found = np.zeros(face.shape[:2], np.uint8)
    for number, color in enumerate((BLANKET, RED), 1):
        found[(np.abs(face.astype(int) - color) < 13).all(axis=-1)] = number  # strips are JPEG
    return found


def test_a_network_names_what_has_no_clear_color_and_replaces_other_names(tmp_path: Path) -> None:
    blocks, graph = flat_house()
    root = export_blocks(tmp_path, [*blocks, LOW_BED], graph)

    def looks(labeler=None, known=()) -> list[tuple[str, str]]:
        views = list(views_from_viewpoints(root, graph, labeler))
        return sorted(t.color_and_shape for t in surroundings_of(graph, list(layers_of(views, graph)), known).things)

    alone = looks()
    assert ("blue", "sofa") in alone and len(alone) == 2  # the bed is gray
    assert looks(by_color, ("bed", "wardrobe")) == [("", "bed"), ("blue", "sofa"), ("red", "wardrobe")]


def test_an_object_without_a_color_may_not_be_confused_with_one_that_has_one(tmp_path: Path) -> None:
    blocks, graph = flat_house()
    root = export_blocks(tmp_path, [*blocks, LOW_BED], graph)
    seen = surroundings_of(
        graph, list(layers_of(list(views_from_viewpoints(root, graph, by_color)), graph)), ("bed", "")
    )
    (bed,) = [i for i, thing in enumerate(seen.things) if thing.shape == "bed"]
    assert any(cue.object_index == bed for cue in cues_along("ad", 0.0, seen))
    sofa = next(i for i, thing in enumerate(seen.things) if thing.shape == "sofa")
    things = list(seen.things)
    things[sofa] = replace(things[sofa], shape="bed")  # blue: "the bed" would mean either
    assert not any(cue.object_index == bed for cue in cues_along("ad", 0.0, replace(seen, things=tuple(things))))


def test_a_text_does_not_say_the_bed_and_the_blue_bed_of_two() -> None:
    legs = [
        Leg(0.0, 2.0, "level", frozenset({Cue("by", look, "", 0.0, i)})) for i, look in enumerate((" bed", "blue bed"))
    ]
    assert [len(leg.cues) for leg in with_one_name_each(legs)] == [1, 0]


def test_names_in_a_description_are_plain_words(tmp_path: Path) -> None:
    result = (
        '[result]\nvalue = "labels_of_pixels"\nimage = "photo"\nmeaning = "labels"\nclasses = 150\nfloor = [3]\n'
        "[result.objects]\nSofa = [23]"
    )
    with pytest.raises(InputError, match=r"objects.Sofa is \[23\]; it must be named with lower-case English words"):
        described("mmseg-ade20k", mmseg(tmp_path / "n.onnx"), more=result)


def test_names_of_networks_become_words() -> None:
    assert plain_name("bed", "") == "bed" and plain_name("washing machine", "blue") == "blue washing machine"
    assert plain_name("sofa", "") == "sofa"


def test_instructions_name_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "models"))
    segformer(tmp_path / "segformer-b0-ade20k.onnx", red=BED)
    assert main(["models", "add", str(tmp_path / "segformer-b0-ade20k.onnx"), "--name", "segformer-b0-ade20k"]) == 0
    blocks, graph = flat_house()
    scans = export_blocks(tmp_path / "scans", [*blocks, replace(LOW_BED, color=PURE_RED)], graph)
    words = ["export", "tasks", "--scans", str(scans), "--out", str(tmp_path / "tasks")]
    words += ["--val-unseen", "0", "--fewest-edges", "2", "--least-meters", "2"]
    assert main([*words, "--objects", "segformer-b0-ade20k"]) == 0
    things = json.loads((tmp_path / "tasks" / "surroundings.json").read_text())["boxes"]["things"]
    assert {"colour": "red", "shape": "bed"}.items() <= things[0].items() or any(t["shape"] == "bed" for t in things)
    said = (tmp_path / "tasks" / "R2R_train.json").read_text()
    assert "bed" in said and "  " not in " ".join(json.loads(said)[0]["instructions"])
    assert (
        json.loads((tmp_path / "tasks" / "tasks.json").read_text())["instructions"]["objects"] == "segformer-b0-ade20k"
    )


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--objects", "bundled"], "bundled names no objects; use a network with classes of furniture"),
        (["--objects", "nothing"], "There is no model 'nothing' for names of objects"),
    ],
)
def test_unsuitable_networks_are_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys, more: list[str], message: str
) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "models"))
    blocks, graph = flat_house()
    scans = export_blocks(tmp_path / "scans", blocks, graph)
    out = tmp_path / "tasks"
    assert main(["export", "tasks", "--scans", str(scans), "--out", str(out), *more]) == 2
    assert message in capsys.readouterr().err and not out.exists()
