"""Measures the cost of the floor and normals networks on images of noise."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.kernel_threads import cores
from nvsim.networks.image_preparation import Image
from nvsim.networks.installed import find_model
from nvsim.perception.normals_network import NormalsNetwork
from nvsim.perception.semantic_network import SemanticNetwork

_DIFFERENT = 8  # images; an open network caches fewer results


def measure(width: int, height: int, images: int, semantic: str, normals: str) -> dict[str, Any]:
    """Time per image in milliseconds, including preparation and resizing.

    ms_per_frame   both networks; they run once if one file predicts both
    semantic_ms    the floor network alone
    normals_ms     the normals network alone

    Each also has the ending _cpu for processor time, which is about the time on one core. size and cores describe the
    measurement. Raises InputError if no network is installed for a role, or a network cannot be opened.
    """
    looks, faces = find_model("semantic", semantic), find_model("normals", normals)
    if looks is None or faces is None:
        raise InputError("There is no network to measure; name them with --semantic and --normals.")
    camera = Camera(Intrinsics.from_fov(width, height, 1.1), camera_pose(np.zeros(3), 0.0))
    rng = np.random.default_rng(0)
    seen = [rng.integers(0, 255, (height, width, 3)).astype(np.uint8) for _ in range(min(images, _DIFFERENT) + 1)]

    def time_call(name: str, *asked: Callable[[Image, Camera], object]) -> dict[str, float]:
        for ask in asked:
            ask(seen[-1], camera)
        wall, cpu = time.perf_counter(), time.process_time()
        for i in range(images):
            for ask in asked:
                ask(seen[i % (len(seen) - 1)], camera)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        return {f"{name}ms{end}": round(1e3 * t / images, 1) for end, t in (("", wall), ("_cpu", cpu))}

    figures: dict[str, Any] = time_call("semantic_", SemanticNetwork(looks.open("cpu")).floor_probability)
    figures |= time_call("normals_", NormalsNetwork(faces.open("cpu")).normals)
    floor, surface = SemanticNetwork(looks.open("cpu")), NormalsNetwork(faces.open("cpu"))
    both = time_call("", floor.floor_probability, surface.normals)
    return {"ms_per_frame": both["ms"], "ms_per_frame_cpu": both["ms_cpu"], **figures, "size": f"{width}x{height}",
            "cores": cores()}  # fmt: skip
