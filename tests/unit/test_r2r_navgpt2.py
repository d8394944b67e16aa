"""The LMDB of NavGPT-2, opened as the agent does, beside the JSON that says which row is whose."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from backbone_samples import mean_network, weights
from export_samples import export, random_graph
from test_r2r_features import WHOLE, by_hand, features

from nvsim.cli.main import main
from nvsim.errors import InputError
from nvsim.events import Progress
from nvsim.files.locking import AlreadyLocked
from nvsim.r2r.features.backbone import Projection
from nvsim.r2r.features.exported_scan import read_exported_scans
from nvsim.r2r.features.extraction import extract_candidates
from nvsim.r2r.features.feature_files import packed_array, write_lmdb
from nvsim.r2r.features.kept_rows import kept_rows
from nvsim.r2r.features.layouts import LAYOUTS

NAME, TOKENS = "MP3D_eva_clip_g_can.lmdb", 257
lmdb = pytest.importorskip("lmdb", reason="the extra `navgpt2` is not installed")
msgpack = pytest.importorskip("msgpack", reason="the extra `navgpt2` is not installed")


def read(path: Path, scan: str, viewpoint: str) -> np.ndarray:
    """As NavGPT-2 does: one key, three entries of bytes, an array of their type and shape."""
    with lmdb.open(str(path), readonly=True, lock=False) as environment, environment.begin() as transaction:
        found = msgpack.unpackb(transaction.get(f"{scan}_{viewpoint}".encode("ascii")))
    return np.frombuffer(found[b"data"], dtype=found[b"type"]).reshape(found[b"shape"])


def test_navgpt2_finds_the_patches_of_every_candidate(tmp_path: Path) -> None:
    graph = random_graph("Hall", 6, reach=9.0)
    export(tmp_path, graph)
    model = mean_network(tmp_path / "mean.onnx", 6, tokens=TOKENS, description=WHOLE)
    assert features(tmp_path, "--layout", "eva-g", "--model", model) == 0
    assert main(["export", "candidates", str(tmp_path)]) == 0
    path = tmp_path / "features" / NAME
    candidates = json.loads((tmp_path / "candidates" / "scanvp_candidates.json").read_text())
    count = 0
    for key, rows in candidates.items():
        id = key.removeprefix("Hall_")
        found = read(path, "Hall", id)
        assert found.shape == (len(rows), TOKENS, 1408) and found.dtype == np.float32
        expected = by_hand(tmp_path, id, weights(TOKENS * 6, 2)).reshape(36, TOKENS, 6)
        assert sorted(row[1] for row in rows.values()) == list(range(len(rows)))
        for view, number, *_ in rows.values():
            np.testing.assert_allclose(found[number, :, :6], expected[view], atol=0.06)
            assert not found[number, :, 6:].any()
            count += 1
    assert count >= 8
    about = json.loads(path.with_suffix(".json").read_text())
    assert "257 rows of a view" in about["features"] and "NavGPT-2" in about["layout"]
    assert [p.name for p in path.iterdir()] == ["data.mdb"] and not list(path.parent.glob(".*"))
    with lmdb.open(str(path), readonly=True, lock=False) as environment, environment.begin() as transaction:
        assert {bytes(key).decode() for key, _ in transaction.cursor()} == set(candidates)


def test_one_row_of_a_view_is_repeated_and_that_is_said(tmp_path: Path) -> None:
    export(tmp_path, random_graph("Hall", 4, reach=20.0))
    assert features(tmp_path, "--layout", "eva-g", "--projection") == 0
    path = tmp_path / "features" / NAME
    found = read(path, "Hall", "hall000")
    assert found.shape == (2, TOKENS, 1408) and (found == found[:, :1]).all() and found[0, 0].std() > 0.01
    assert "one row of a view, repeated 257 times" in json.loads(path.with_suffix(".json").read_text())["features"]


def test_a_viewpoint_without_neighbors_has_no_rows(tmp_path: Path) -> None:
    export(tmp_path, random_graph("Hall", 3, reach=0.01))
    assert features(tmp_path, "--layout", "eva-g", "--projection") == 0
    assert read(tmp_path / "features" / NAME, "Hall", "hall002").shape == (0, TOKENS, 1408)


def test_what_was_finished_before_a_kill_is_not_computed_again(tmp_path: Path) -> None:
    export(tmp_path, random_graph("Hall", 5, reach=20.0))
    scans, layout = read_exported_scans(tmp_path), LAYOUTS["eva-g"]

    def cut_off(event: object) -> None:
        if isinstance(event, Progress) and event.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        extract_candidates(scans, layout, Projection(1408), tmp_path / "f", cut_off)
    assert not (tmp_path / "f" / NAME).exists()
    heard: list[int] = []
    extract_candidates(
        scans,
        layout,
        Projection(1408),
        tmp_path / "f",
        lambda e: heard.append(e.done) if isinstance(e, Progress) else None,
    )
    assert heard == [3, 4]
    extract_candidates(scans, layout, Projection(1408), tmp_path / "whole", lambda _: None)
    for id in scans[0].viewpoints:
        np.testing.assert_array_equal(
            read(tmp_path / "f" / NAME, "Hall", id), read(tmp_path / "whole" / NAME, "Hall", id)
        )


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    with (
        kept_rows(tmp_path / NAME, "a"),
        pytest.raises(AlreadyLocked),
        kept_rows(tmp_path / NAME, "a"),
    ):
        pass


def test_a_file_that_grows_beyond_its_room_is_one_sentence(tmp_path: Path) -> None:
    with (
        pytest.raises(InputError, match="Cannot write .*free some space"),
        kept_rows(tmp_path / NAME, "a") as rows,
    ):
        keys = {f"key{n}": f"key{n}".encode() for n in range(100)}
        for key in keys:
            rows.append(key, b"", packed_array(np.zeros(1 << 20, np.float32)))
        write_lmdb(tmp_path / NAME, rows, keys, 1)
    assert not (tmp_path / NAME).exists()


def test_tokens_where_one_row_is_read_and_the_other_way_round(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    export(tmp_path, random_graph("Hall", 3))
    model = mean_network(tmp_path / "mean.onnx", 4, tokens=9, description=WHOLE)
    assert features(tmp_path, "--model", model) == 2
    assert "gives 9 rows of numbers for each view, but the layout vit-b16 needs one" in capsys.readouterr().err
    assert features(tmp_path, "--layout", "eva-g", "--model", model) == 2
    assert "the layout eva-g needs 257" in capsys.readouterr().err
    model.with_suffix(".toml").write_text(model.with_suffix(".toml").read_text().replace("tokens = 9", "tokens = 8"))
    assert features(tmp_path, "--layout", "eva-g", "--model", model) == 2
    assert "tokens = 8 rows of width = 4" in capsys.readouterr().err


def test_without_the_packages_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name == "lmdb" else find(name, *a))
    monkeypatch.setitem(sys.modules, "lmdb", None)
    export(tmp_path, random_graph("Hall", 3))
    assert features(tmp_path, "--layout", "eva-g", "--projection") == 2
    assert "pip install lmdb msgpack" in capsys.readouterr().err
