"""`nvsim models` lists networks, installs them, and reports their errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from floor_networks import segformer
from normal_networks import metric3d, moge, own
from prompted_networks import pair

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.networks.installed import find_model, installed_models
from nvsim.perception.normals_network import installed_normals
from nvsim.perception.prompted_network import PromptedNetwork


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "models"
    monkeypatch.setenv("NVSIM_MODELS", str(folder))
    return folder


def listed(capsys: pytest.CaptureFixture[str]) -> dict:
    """The catalog, without the models that come with NVSim."""
    capsys.readouterr()
    assert main(["models", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    found["models"] = [row for row in found["models"] if not row["name"].startswith("bundled")]
    return found


def test_a_model_is_named_after_its_files_and_found_by_role_and_name(models: Path, tmp_path: Path, capsys) -> None:
    encoder, decoder = pair(tmp_path / "downloads", "sam2-samexporter")
    encoder = encoder.rename(encoder.with_name("sam2.1_hiera_tiny.encoder.onnx"))
    decoder = decoder.rename(decoder.with_name("sam2.1_hiera_tiny.decoder.onnx"))
    assert main(["models", "add", str(decoder), str(encoder)]) == 0
    assert "sam2.1-tiny is installed in" in capsys.readouterr().out
    network = find_model("prompted", "sam2.1-tiny")
    assert network is not None and network.folder == models / "sam2.1-tiny"
    found = PromptedNetwork(network.open("cpu")).region(
        np.zeros((90, 120, 3), np.uint8), np.array([[40.0, 40.0]]), np.ones(1, bool)
    )
    assert found[40, 40] and not found[80, 110]
    (row,) = listed(capsys)["models"]
    assert row["licence"] == "Apache-2.0" and row["made_by"].startswith("Meta AI") and row["megabytes"] > 0.001
    assert main(["models", "check"]) == 0
    assert "sam2.1-tiny: a region of" in capsys.readouterr().out


def test_what_is_not_installed_is_listed_with_where_it_comes_from_and_what_it_improves(models: Path, capsys) -> None:
    found = listed(capsys)
    assert found["folder"] == str(models) and found["models"] == []
    lacking = {row["role"]: row for row in found["lacking"]}
    assert len(lacking) == 4 and "holes of a LiDAR scan" in lacking["floor segmentation"]["improves"]
    known = {name: k for row in lacking.values() for k in row["known"] for name in k["names"]}
    assert known["metric3d-vit-small"]["licence"].startswith("BSD") and known["sam2.1-tiny"]["source"].startswith(
        "http"
    )
    assert main(["models"]) == 0 and "moge-2-vits" in capsys.readouterr().out


def test_the_files_of_old_are_found_beside_new_models_and_come_after_them(models: Path, tmp_path: Path, capsys) -> None:
    models.mkdir()
    own(models / "normals.onnx")
    assert [m.name for m in installed_models()[0]] == ["normals"] and installed_normals() is not None
    assert main(["models", "add", str(moge(tmp_path / "x.onnx")), "--name", "mine"]) == 0
    assert find_model("normals").name == "mine" and find_model("normals", "normals").name == "normals"  # type: ignore[union-attr]
    metric3d(models / "lpips.onnx")
    (models / "features.vit-b16.toml").write_text("width = 3\nsize = 3\n")
    rows = {row["name"]: row for row in listed(capsys)["models"]}
    assert set(rows) == {"normals", "mine", "lpips"} and "LPIPS" in rows["lpips"]["improves"]


def test_a_model_with_its_weights_beside_it_is_installed_whole(models: Path, tmp_path: Path) -> None:
    import onnx

    loaded = onnx.load(segformer(tmp_path / "a.onnx"))
    path = tmp_path / "hub" / "segformer-b0-ade20k" / "model.onnx"
    path.parent.mkdir(parents=True)
    onnx.save(loaded, path, save_as_external_data=True, location="model.onnx_data", size_threshold=0)
    assert main(["models", "add", str(path.parent)]) == 0
    model = find_model("semantic", "segformer-b0-ade20k")
    assert model is not None and {p.name for p in model.sources} == {"model.onnx", "model.onnx_data", "model.toml"}
    model.open("cpu")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["{folder}/nothing.onnx"], "nothing.onnx: it does not exist"),
        (["{folder}"], "no ONNX file in"),
        (["{good}", "--name", "../x"], "cannot be called '../x'"),
        (["{good}", "--form", "sam3"], "no form 'sam3'; the forms are"),
        (["{good}", "--form", "moge-2"], "fits the form moge-2; describe the model"),
        (["{bad}"], "cannot be loaded"),
        (["{strange}"], "strange.onnx fits none of the forms .*describe the model in a TOML beside it"),
    ],
)
def test_what_cannot_be_installed_leaves_nothing_behind(
    models: Path, tmp_path: Path, words: list[str], sentence: str, capsys
) -> None:
    good = metric3d(tmp_path / "good.onnx")
    strange = own(tmp_path / "strange.onnx")
    (tmp_path / "bad.onnx").write_bytes(b"no network")
    (tmp_path / "empty").mkdir()
    places = {"folder": tmp_path / "empty", "good": good, "bad": tmp_path / "bad.onnx", "strange": strange}
    assert main(["models", "add", *(w.format(**places) for w in words)]) == 2
    said = capsys.readouterr().err
    import re

    assert re.search(sentence.replace("fits the form", "fits? the form"), said) and said.count("\n") == 1
    assert not models.exists() or not list(models.iterdir())


def test_a_model_of_that_name_is_only_replaced_where_one_says_so(models: Path, tmp_path: Path, capsys) -> None:
    path = metric3d(tmp_path / "x.onnx")
    add = ["models", "add", str(path), "--name", "mine"]
    assert main(add) == 0
    before = (models / "mine" / "x.onnx").read_bytes()
    metric3d(path, offset=(0.0, 0.0, -0.5))
    assert main(add) == 2 and "give --replace" in capsys.readouterr().err
    assert (models / "mine" / "x.onnx").read_bytes() == before
    assert main([*add, "--replace"]) == 0
    assert (models / "mine" / "x.onnx").read_bytes() == path.read_bytes()
    assert [p.name for p in models.iterdir()] == ["mine"]


def test_a_file_that_changed_since_and_an_answer_that_cannot_be_are_said(models: Path, tmp_path: Path, capsys) -> None:
    turned = metric3d(tmp_path / "turned.onnx", np.zeros((3, 3)), (0.0, 0.0, 1.0))
    good = metric3d(tmp_path / "good.onnx", np.zeros((3, 3)), (0.0, -0.7, -0.7))
    for path in (turned, good):
        assert main(["models", "add", str(path), "--name", path.stem]) == 0
    capsys.readouterr()
    assert main(["models", "check"]) == 1
    said = capsys.readouterr().out
    assert "turned: " in said and "point away from the camera" in said and "ms per image" in said
    assert main(["models", "check", "good"]) == 0
    with open(models / "good" / "good.onnx", "ab") as file:
        file.write(b"\0")
    assert main(["models", "check", "good", "--json"]) == 1
    assert "is not the file that was described" in capsys.readouterr().out
    assert (
        main(["models", "check", "best"]) == 2
        and "no model 'best' (installed: good, turned, bundled-floor, bundled-normals)" in capsys.readouterr().err
    )


def test_a_description_of_ones_own_is_installed_with_its_file(models: Path, tmp_path: Path, capsys) -> None:
    own(tmp_path / "mine.onnx")
    (tmp_path / "mine.toml").write_text(
        """
role = "normals"
title = "Ours"
[files]
network = { file = "mine.onnx" }
[images.photo]
resize = "centre"
[[steps]]
file = "network"
inputs = [{ value = "photo", name = "input" }]
outputs = [{ value = "normals", name = "out" }]
[result]
value = "normals"
image = "photo"
halved = true
axes = ["left", "up", "backward"]
"""
    )
    assert main(["models", "add", str(tmp_path / "mine.onnx"), str(tmp_path / "mine.toml")]) == 0
    assert find_model("normals", "mine").description.title == "Ours"  # type: ignore[union-attr]
    (models / "mine" / "model.toml").write_text("role = 3")
    assert any("role is 3" in problem for problem in listed(capsys)["problems"])
    assert main(["models", "check"]) == 1


def test_an_invalid_description_is_reported_only_for_its_own_name(models: Path) -> None:
    for path in (models / "house" / "model.toml", models / "warehouse.toml"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("role = 'normals'\nnonsense = 'prompted.encoder.onnx'\n")
    for name in ("house", "warehouse"):
        with pytest.raises(InputError, match=rf"{name}(/model)?\.toml"):
            find_model("normals", name)
    with pytest.raises(InputError, match="There is no model 'use'"):
        find_model("normals", "use")
    assert find_model("prompted") is None


def test_an_incomplete_prompted_model_is_reported(models: Path) -> None:
    models.mkdir(parents=True, exist_ok=True)
    (models / "prompted.encoder.onnx").write_bytes(b"x")
    for name in ("", "prompted"):
        with pytest.raises(InputError, match="prompted.decoder.onnx is missing"):
            find_model("prompted", name)
