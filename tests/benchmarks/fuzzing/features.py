"""Features of views in files for agents, rows of unfinished exports, and networks that compute features."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from backbone_samples import mean_network

from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, each, files_in
from nvsim.r2r.features.feature_files import RowSource, backbone_of_file, features_of, write_hdf5, write_tsv
from nvsim.r2r.features.kept_rows import kept_rows
from nvsim.r2r.features.network import Network

_KEYS = [("row", f"v{k}") for k in range(3)]
_WIDTH = 8
_KEPT = ("row_v0", "row_v1", "row_v2")


def readers() -> list[Reader]:
    return [
        Reader("features hdf5", _hdf5, _features, share=3),
        Reader("features tsv", _tsv, _features),
        Reader("kept rows of features", _kept, _take_over, disposable=True),
        Reader("network of features", _network, _run, share=2),
    ]


def _rows():
    numbers = np.random.default_rng(0).standard_normal((36, _WIDTH)).astype(np.float32)
    return [(RowSource(scan, viewpoint, (640, 480)), numbers) for scan, viewpoint in _KEYS]


def _hdf5() -> list[Seed]:
    with workshop() as folder:
        write_hdf5(folder / "f.hdf5", _rows(), {"backbone": "chance"}, 60)
        return each(files_in(folder), "f.hdf5", {"f.hdf5": "binary"})


def _tsv() -> list[Seed]:
    with workshop() as folder:
        write_tsv(folder / "f.tsv", _rows(), {"backbone": "chance"}, 60)
        return each(files_in(folder), "f.tsv", {"f.tsv": "text", "f.json": "json"})


def _features(path: Path) -> object:
    return backbone_of_file(path), list(features_of(path, _KEYS))


_MARK = bytes(16)


def _kept() -> list[Seed]:
    """The rows that a killed export leaves, from which the next export continues."""
    with workshop() as folder:
        try:
            with kept_rows(folder / "f.tsv", "a") as rows:
                for key in _KEPT:
                    rows.append(key, _MARK, bytes(100))
                files = {n: d for n, d in files_in(folder).items() if not n.endswith("lock")}
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            pass
    return each(files, "f.tsv", {name: "binary" for name in files})


def _take_over(path: Path) -> object:
    with kept_rows(path, "a") as rows:
        return [rows.get(key) for key in _KEPT if rows.contains(key, _MARK)]


def _network() -> list[Seed]:
    with workshop() as folder:
        mean_network(folder / "mean.onnx", _WIDTH)
        files = files_in(folder)
    return each(files, "mean.onnx", {"mean.onnx": "binary", "mean.toml": "text"})


def _run(path: Path) -> object:
    return Network(path, 2, "cpu").digest
