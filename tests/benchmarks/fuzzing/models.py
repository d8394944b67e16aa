"""Submap models with their networks, checkpoints, camera paths, and frame candidates."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from fuzzing.places import workshop
from fuzzing.reader import Files, Reader, Seed, each, files_in
from fuzzing.splats import gaussians
from nvsim.geometry.camera_path import KeyPose, read_camera_path, write_camera_path
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.project.frame_candidates import read_candidates
from nvsim.splats import files
from nvsim.splats.appearance import LinearAppearance, NetworkAppearance
from nvsim.splats.files import save_model
from nvsim.splats.types import Background, Embedding, FloorTexture, SubmapModel
from nvsim.training import checkpoint


def readers() -> list[Reader]:
    return [
        Reader("model folder", _models, _load, share=4),
        Reader("checkpoint", _checkpoints, _resume, share=2),
        Reader("camera path", _paths, _path),
        Reader("frame candidates", _candidates, _read_candidates),
    ]


def _model(kind: str):
    r = np.random.default_rng(0)

    def noise(*shape: int) -> np.ndarray:
        return r.normal(size=shape).astype(np.float32)

    return SubmapModel(
        gaussians(12),
        Background({"base.weight": noise(3, 4), "base.bias": noise(3)}, 3, 4.5),
        FloorTexture((noise(2, 3, 3), noise(4, 5, 3)), (-1.0, 2.0), (3.5, 4.0)),
        FloorSurface(noise(3, 2), (0.5, -0.5), 0.75),
        True,
        {"preset": "nvsim", "steps": 10, "psnr": 27.5},
        _appearance(kind, noise),
    )


def _appearance(kind: str, noise):
    if kind == "none":
        return None
    embedding = Embedding({}, 2, 5.0, False)
    weights = {"matrix.weight": noise(6, 4), "matrix.bias": noise(6)}
    if kind == "linear":
        return LinearAppearance(embedding, weights, noise(12, 2), np.zeros(3))
    return NetworkAppearance(embedding, weights, noise(12, 2), np.zeros(3))


def model_files(kind: str) -> Files:
    """The files of a small model. `kind` is that of its appearance: none, linear, or network."""
    with workshop() as folder:
        save_model(_model(kind), folder)
        return files_in(folder)


def _sealed(files: Files) -> Files:
    """The files, after their sizes and hashes in model.json are updated."""
    try:
        data = json.loads(files["model.json"])
        for name in list(data["files"]):
            content = files[name]
            data["files"][name] = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        return {**files, "model.json": json.dumps(data).encode()}
    except (ValueError, KeyError, TypeError, RecursionError):
        return files


def _models() -> list[Seed]:
    seeds = []
    for kind in ("none", "linear", "network"):
        files = model_files(kind)
        forms = {".ply": "headed", ".safetensors": "tensors"}
        binary = {n: forms[Path(n).suffix] for n in files if n != "model.json"}
        seeds += [*each(files, "", {"model.json": "json"}), *each(files, "", binary, _sealed)]
    return seeds


def _load(path: Path) -> object:
    files._verified.clear()
    files.memory_needed(path)
    return files.load_model(path)


_KEY = "key"


def _checkpoints() -> list[Seed]:
    arrays = {"gaussians/means": np.ones((5, 3), np.float32), "optimizer/step": np.array(3)}
    progress = {"order": [1, 2], "loss": 0.5, "random": {"state": 5}}
    with workshop() as folder:
        checkpoint.save(folder / "c.ckpt", checkpoint.Checkpoint(7, arrays, progress), _KEY)
        return each(files_in(folder), "c.ckpt", {"c.ckpt": "zip"})


def _resume(path: Path) -> object:
    return checkpoint.load(path, _KEY)


def _paths() -> list[Seed]:
    with workshop() as folder:
        write_camera_path(folder / "p.json", [KeyPose((0.0, k, 1.5), 0.1 * k) for k in range(3)])
        return each(files_in(folder), "p.json", {"p.json": "json"})


def _path(path: Path) -> object:
    return [pose.camera(64, 48) for pose in read_camera_path(path).frames(5)]


def _candidates() -> list[Seed]:
    bits = np.packbits(np.eye(12, 16, dtype=bool))
    masks = {name: bits for name in ("semantic", "horizontal", "candidates", "prompted")}
    with workshop() as folder:
        shape = {"shape": np.array((12, 16)), "points": np.zeros((2, 2)), "normals": np.zeros((12, 16, 3), np.int8)}
        np.savez_compressed(folder / "c.npz", **shape, **masks)
        return each(files_in(folder), "c.npz", {"c.npz": "zip"})


def _read_candidates(path: Path) -> object:
    return read_candidates(path)
