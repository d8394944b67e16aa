"""Streamed SOGs: of several levels of detail in folders, one is read."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_splats_formats import sog, wall

from nvsim.errors import InputError
from nvsim.project.path_kind import check_openable
from nvsim.splats.formats import sog as sog_format
from nvsim.splats.formats.choice import files_of, read_splats
from nvsim.splats.formats.sog import level_to_read

COUNTS = {"0_0": 40, "0_1": 30, "1_0": 20}


@pytest.fixture
def index(tmp_path: Path) -> Path:
    """Two SOGs at level 0 and one at level 1, laid out as PlayCanvas writes them."""
    for seed, (name, count) in enumerate(COUNTS.items()):
        (tmp_path / name).mkdir()
        for file, data in sog(wall(count, seed), seed)[0].items():
            (tmp_path / name / file).write_bytes(data)
    part = {"offset": 0, "bound": {"min": [0, 0, 0], "max": [1, 1, 1]}}
    tree = {
        "children": [
            {"lods": {"0": {**part, "file": 0, "count": 40}, "1": {**part, "file": 2, "count": 12}}},
            {"lods": {"0": {**part, "file": 1, "count": 30}, "1": {**part, "file": 2, "count": 8}}},
        ]
    }
    names = [f"{name}/meta.json" for name in COUNTS]
    (tmp_path / "lod-meta.json").write_text(json.dumps({"lodLevels": 2, "filenames": names, "tree": tree}))
    return tmp_path / "lod-meta.json"


def test_the_finest_level_is_that_of_its_files(index: Path) -> None:
    check_openable(index)
    found = read_splats(index)
    parts = [read_splats(index.parent / name / "meta.json").gaussians for name in ("0_0", "0_1")]
    np.testing.assert_array_equal(found.gaussians.means, np.concatenate([part.means for part in parts]))
    np.testing.assert_allclose(found.gaussians.sh[:, 0], np.concatenate([part.sh[:, 0] for part in parts]))
    assert files_of(index) == [index, *(index.parent / name / "meta.json" for name in ("0_0", "0_1"))]
    assert "level 0 with 70" in found.notes[-1]


@pytest.mark.parametrize(("most", "level"), [(70, 0), (69, 1), (20, 1), (5, 1)])
def test_a_level_that_is_too_large_is_replaced_by_a_coarser_one(
    index: Path, most: int, level: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sog_format, "_MOST_GAUSSIANS", most)
    found = level_to_read(index)
    assert (found.number, found.levels, found.count, found.finest) == (level, 2, (70, 20)[level], 70)
    assert len(read_splats(index).gaussians) == (70, 20)[level]


BOX = {"file": 0, "count": 3}


@pytest.mark.parametrize(
    ("meta", "words"),
    [
        ([], "no list of file names"),
        ({"filenames": []}, "no list of file names"),
        ({"filenames": ["0_0/meta.json"]}, "no valid tree"),
        ({"filenames": ["0_0/meta.json"], "tree": {}}, "no level of detail"),
        ({"filenames": ["0_0/meta.json"], "tree": {"children": {}}}, "no valid tree"),
        ({"filenames": ["0_0/meta.json"], "tree": {"lods": {"0": {**BOX, "file": 1}}}}, "as level"),
        ({"filenames": ["0_0/meta.json"], "tree": {"lods": {"0": {**BOX, "count": -1}}}}, "as level"),
        ({"filenames": ["0_0/meta.json"], "tree": {"lods": {"0": {**BOX, "count": True}}}}, "as level"),
        ({"filenames": ["0_0/meta.json"], "tree": {"lods": {"x": BOX}}}, "as level"),
        ({"filenames": ["../0_0/meta.json"], "tree": {"lods": {"0": BOX}}}, "not a SOG in its folder"),
        ({"filenames": ["/etc/meta.json"], "tree": {"lods": {"0": BOX}}}, "not a SOG in its folder"),
        ({"filenames": ["lod-meta.json"], "tree": {"lods": {"0": BOX}}}, "not a SOG in its folder"),
        ({"filenames": ["a.splats"], "tree": {"lods": {"0": BOX}}}, "not a SOG in its folder"),
        ({"filenames": [""], "tree": {"lods": {"0": BOX}}}, "not a SOG in its folder"),
        ({"filenames": [3], "tree": {"lods": {"0": BOX}}}, "not a SOG in its folder"),
    ],
)
def test_a_damaged_index_is_one_sentence(index: Path, meta: Any, words: str) -> None:
    index.write_text(json.dumps(meta))
    with pytest.raises(InputError, match=words):
        read_splats(index)


def test_a_missing_part_is_named(index: Path) -> None:
    (index.parent / "0_1" / "meta.json").unlink()
    with pytest.raises(InputError, match="0_1"):
        read_splats(index)
