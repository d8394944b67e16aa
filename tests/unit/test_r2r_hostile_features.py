"""HDF5 files of features over which the HDF5 library crashes or never returns."""

from __future__ import annotations

import gzip
from pathlib import Path

import h5py
import numpy as np
import pytest
from obedient_child import Silent

from nvsim.errors import InputError
from nvsim.processes.child import Limits
from nvsim.r2r.features import feature_files
from nvsim.r2r.features.feature_files import backbone_of_file, features_of

DATA = Path(__file__).parents[1] / "data"
"""`features_endless.h5` and `features_crashing.h5` were written with h5py 3.16 (HDF5 2.0) and some bytes changed."""
KEYS = [("s", "v0"), ("s", "v1")]


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feature_files, "_LIMITS", Limits(seconds=3, memory=512 << 20))


@pytest.mark.parametrize("name", ["endless", "crashing"])
def test_a_file_over_which_the_library_fails_is_a_sentence(tmp_path: Path, name: str) -> None:
    path = tmp_path / "x.h5"
    path.write_bytes(gzip.decompress((DATA / f"features_{name}.h5.gz").read_bytes()))
    # Another version of the library may read the file or refuse it; this process must not be harmed.
    try:
        backbone_of_file(path)
        list(features_of(path, KEYS))
    except InputError as error:
        assert str(path) in str(error) and "\n" not in str(error)


def test_no_answer_in_time_names_the_file_and_the_next_file_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file.attrs["backbone"] = "mine"
        for scan, viewpoint in KEYS:
            file[f"{scan}_{viewpoint}"] = np.full((36, 5), 2.0, np.float32)
    with monkeypatch.context() as patch:
        patch.setattr(feature_files, "Hdf5Server", Silent)
        patch.setattr(feature_files, "_LIMITS", Limits(seconds=0.1))
        with pytest.raises(InputError, match="x.h5 gives no answer within 0.1 s; write it again"):
            backbone_of_file(path)
    monkeypatch.setattr(feature_files, "_LIMITS", Limits(seconds=60))
    assert backbone_of_file(path) == "mine"
    found = dict(features_of(path, KEYS))
    assert set(found) == set(KEYS) and all((row == 2).all() and row.shape == (36, 5) for row in found.values())
