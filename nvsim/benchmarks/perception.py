"""What the networks of floor and normals cost, on an image of noise."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.kernel_threads import cores
from nvsim.networks.installed import find_model
from nvsim.perception.normals_network import NormalsNetwork
from nvsim.perception.semantic_network import SemanticNetwork


def measure(width: int, height: int, images: int, semantic: str, normals: str) -> dict[str, Any]:
    """ms_per_frame, of both networks; semantic_ms and normals_ms, preparation and resizing included, and as processor
    time with _cpu, what one core would take about; size and cores. Raises InputError."""
    looks, faces = find_model("semantic", semantic), find_model("normals", normals)
    if looks is None or faces is None:
        raise InputError("There is no network to measure; name them with --semantic and --normals.")
    camera = Camera(Intrinsics.from_fov(width, height, 1.1), look(np.zeros(3), 0.0))
    image = np.random.default_rng(0).integers(0, 255, (height, width, 3)).astype(np.uint8)
    floor, surface = SemanticNetwork(looks.open("cpu")), NormalsNetwork(faces.open("cpu"))
    figures: dict[str, Any] = {}
    for name, ask in (("semantic", floor.floor_probability), ("normals", surface.normals)):
        ask(image, camera)
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(images):
            ask(image, camera)
        figures[f"{name}_ms"] = round(1e3 * (time.perf_counter() - wall) / images, 1)
        figures[f"{name}_ms_cpu"] = round(1e3 * (time.process_time() - cpu) / images, 1)
    total = round(figures["semantic_ms"] + figures["normals_ms"], 1)
    return {"ms_per_frame": total, **figures, "size": f"{width}x{height}", "cores": cores()}
