"""Features of views in the files of agents, what is kept of unfinished ones, and networks that make them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fuzzing.places import workshop
from fuzzing.reader import Reader, Seed, each, files_in

_KEYS = [("row", f"v{k}") for k in range(3)]
_WIDTH = 8


def readers() -> list[Reader]:
    return [
        Reader("features hdf5", _hdf5, _features, share=3),
        Reader("features tsv", _tsv, _features),
        Reader("features lmdb", _lmdb, _grow, disposable=True, share=2),
        Reader("kept rows of features", _kept, _take_over, disposable=True),
        Reader("network of features", _network, _run, share=2),
    ]


def _rows():
    from nvsim.r2r.features.feature_files import Place

    numbers = np.random.default_rng(0).standard_normal((36, _WIDTH)).astype(np.float32)
    return [(Place(scan, viewpoint, (640, 480)), numbers) for scan, viewpoint in _KEYS]


def _hdf5() -> list[Seed]:
    from nvsim.r2r.features.feature_files import write_hdf5

    with workshop() as folder:
        write_hdf5(folder / "f.hdf5", _rows(), {"backbone": "chance"}, 60)
        return each(files_in(folder), "f.hdf5", {"f.hdf5": "binary"})


def _tsv() -> list[Seed]:
    from nvsim.r2r.features.feature_files import write_tsv

    with workshop() as folder:
        write_tsv(folder / "f.tsv", _rows(), {"backbone": "chance"}, 60)
        return each(files_in(folder), "f.tsv", {"f.tsv": "text", "f.json": "json"})


def _features(path: Path) -> object:
    from nvsim.r2r.features.feature_reading import features_of, made_by

    return made_by(path), list(features_of(path, _KEYS))


def _lmdb() -> list[Seed]:
    """What a killed export leaves, which the next one goes on with."""
    from nvsim.r2r.features.lmdb_file import growing_lmdb

    with workshop() as folder:
        try:
            with growing_lmdb(folder / "f", "a", 1 << 16, 4) as file:
                for key in ("row_v0", "row_v1"):
                    file.put(key, b"mark", np.ones((36, _WIDTH), np.float32))
                files = {n: d for n, d in files_in(folder).items() if "lock" not in n}
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            pass
    return each(files, "f", {next(iter(files)): "binary"})


def _grow(path: Path) -> object:
    from nvsim.r2r.features.lmdb_file import growing_lmdb

    with growing_lmdb(path, "a", 1 << 16, 4) as file:
        found = [file.has(key, b"mark") for key in ("row_v0", "row_v1", "row_v2")]
        file.put("row_v2", b"mark", np.ones((36, _WIDTH), np.float32))
        file.finish({"row_v0", "row_v1", "row_v2"})
    return found


_MARK = bytes(16)


def _kept() -> list[Seed]:
    from nvsim.r2r.features.kept_rows import kept_rows

    with workshop() as folder:
        try:
            with kept_rows(folder / "f.tsv", "a", _WIDTH) as rows:
                for _ in range(3):
                    rows.append(_MARK, (640, 480), np.ones((36, _WIDTH), np.float32))
                files = {n: d for n, d in files_in(folder).items() if not n.endswith("lock")}
                raise KeyboardInterrupt
        except KeyboardInterrupt:
            pass
    return each(files, "f.tsv", {name: "binary" for name in files})


def _take_over(path: Path) -> object:
    from nvsim.r2r.features.kept_rows import kept_rows

    with kept_rows(path, "a", _WIDTH) as rows:
        rows.take_over([_MARK] * 3)
        return list(rows)


def _network() -> list[Seed]:
    from backbone_samples import mean_network

    with workshop() as folder:
        mean_network(folder / "mean.onnx", _WIDTH)
        files = files_in(folder)
    return each(files, "mean.onnx", {"mean.onnx": "binary", "mean.toml": "text"})


def _run(path: Path) -> object:
    from nvsim.r2r.features.network import Network

    return Network(path, 2, "cpu").digest
