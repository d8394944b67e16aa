"""Splat files of all supported formats, as the window and the commands read them."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import cv2
import numpy as np

from fuzzing.places import shared, workshop
from fuzzing.reader import Files, Reader, Seed, each
from nvsim.splats.formats.choice import write_splats
from nvsim.splats.types import Gaussians
from nvsim_app.state.opened_files import SplatFile


def readers() -> list[Reader]:
    return [
        Reader("splat ply", _ply, _read, share=2),
        Reader("compressed ply", _compressed, _read),
        Reader("spz", _spz, _read, share=2),
        Reader("sog", _sog, _read, share=2),
        Reader("sog folder", _sog_folder, _read),
        Reader("splat", _splat, _read),
    ]


def _read(path: Path) -> object:
    file = SplatFile.of(path)
    return file.contents()


def gaussians(count: int = 30, degree: int = 1):
    """A few Gaussians with direction-dependent colors."""
    r = np.random.default_rng(0)
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, (degree + 1) ** 2, 3))
    return Gaussians(*(r.normal(size=s).astype(np.float32) for s in shapes))


def _written(form: str, suffix: str, degrees: tuple[int, ...]) -> list[bytes]:
    found = []
    with workshop() as folder:
        for degree in degrees:
            path = folder / f"g{suffix}"
            write_splats(path, gaussians(degree=degree), True, form)  # type: ignore[arg-type]
            found.append(path.read_bytes())
    return found


def _single(name: str, contents: list[bytes], form: str) -> list[Seed]:
    return [Seed({name: data}, name, name, form) for data in contents]


def _ply() -> list[Seed]:
    return _single("g.ply", _written("ply", ".ply", (0, 3)), "headed")


def _compressed() -> list[Seed]:
    return _single("g.ply", _written("compressed-ply", ".compressed.ply", (0, 2)), "headed")


def _spz() -> list[Seed]:
    theirs = [p.read_bytes() for p in shared("splats/minimal-*.spz")]
    zipped = [d for d in [*_written("spz", ".spz", (0, 3)), *theirs] if d[:2] == b"\x1f\x8b"]
    raw = [d for d in theirs if d[:2] != b"\x1f\x8b"]
    return [*_single("g.spz", zipped, "gzip"), *_single("g.spz", raw, "binary")]


def _splat() -> list[Seed]:
    r = np.random.default_rng(1)
    rows = b"".join(r.uniform(0.1, 1, 6).astype("<f4").tobytes() + r.bytes(8) for _ in range(20))
    return _single("g.splat", [rows, *(p.read_bytes() for p in shared("splats/minimal.splat"))], "binary")


def _parts() -> Files:
    """An unpacked SOG of 20 Gaussians with coefficients of the first band."""
    r, count = np.random.default_rng(2), 20
    files: Files = {}

    def image(name: str, pixels: np.ndarray) -> list[str]:
        files[name] = cv2.imencode(".webp", pixels.astype(np.uint8), [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()
        return [name]

    def noise(rows: int = 5, columns: int = 4, channels: int = 4) -> np.ndarray:
        return r.integers(0, 256, (rows, columns, channels))

    quats = noise()
    quats[..., 3] = r.integers(252, 256, (5, 4))
    labels = np.zeros((5, 4, 4))
    labels[..., 3] = 255
    codebook = r.normal(size=256).tolist()
    files["meta.json"] = json.dumps(
        {
            "version": 2,
            "count": count,
            "antialias": False,
            "means": {
                "mins": [-1, -1, -1],
                "maxs": [1, 1, 1],
                "files": image("means_l.webp", noise()) + image("means_u.webp", noise()),
            },
            "scales": {"codebook": codebook, "files": image("scales.webp", noise())},
            "quats": {"files": image("quats.webp", quats)},
            "sh0": {"codebook": codebook, "files": image("sh0.webp", noise())},
            "shN": {
                "count": 64,
                "bands": 1,
                "codebook": codebook,
                "files": image("shN_centroids.webp", noise(1, 192, 3)) + image("shN_labels.webp", labels),
            },
        }
    ).encode()
    return files


def _sog() -> list[Seed]:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in _parts().items():
            archive.writestr(name, data)
    return _single("g.sog", [out.getvalue()], "zip")


def _sog_folder() -> list[Seed]:
    files = _parts()
    images = each(files, "meta.json", {n: "picture" for n in files if n.endswith(".webp")})
    return [*each(files, "meta.json", {"meta.json": "json"}) * 5, *images]
