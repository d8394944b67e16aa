"""Write meshes as glTF 2.0 in one binary file (Khronos, glTF 2.0 specification, section 4: GLB)."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.splats.floor_mesh import FloorMesh

_FLOAT, _UINT32, _UINT8 = 5126, 5125, 5121
_VERTICES, _INDICES = 34962, 34963
_JSON, _BIN = b"JSON", b"BIN\0"


def write_glb(path: Path, mesh: FloorMesh, name: str) -> None:
    """Writes the mesh atomically, without lighting, so that it looks as in the images. In glTF y is up: the root node
    rotates z to y, and the vertices keep their coordinates. Raises InputError if the disk refuses."""
    encoded, png = cv2.imencode(".png", mesh.image[..., [2, 1, 0, 3]])
    if not encoded:
        raise ValueError(f"an image of {mesh.image.shape} cannot be encoded")
    blobs = [mesh.vertices.astype("<f4").tobytes(), mesh.uvs.astype("<f4").tobytes()]
    blobs += [mesh.triangles.astype("<u4").tobytes(), png.tobytes()]
    views, body = _buffer(blobs, (_VERTICES, _VERTICES, _INDICES, None))
    half = float(np.sqrt(0.5))
    root = {
        "asset": {"version": "2.0", "generator": "NVSim"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0, "rotation": [-half, 0.0, 0.0, half]}],
        "meshes": [
            {
                "name": name,
                "primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}],
            }
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _FLOAT,
                "count": len(mesh.vertices),
                "type": "VEC3",
                "min": mesh.vertices.min(axis=0).tolist(),
                "max": mesh.vertices.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": _FLOAT, "count": len(mesh.uvs), "type": "VEC2"},
            {"bufferView": 2, "componentType": _UINT32, "count": mesh.triangles.size, "type": "SCALAR"},
        ],
        "materials": [
            {
                "name": "floor",
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": 0},
                    "metallicFactor": 0.0,
                    "roughnessFactor": 1.0,
                },
                "alphaMode": "MASK",
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "bufferViews": views,
        "buffers": [{"byteLength": len(body)}],
        "extensionsUsed": ["KHR_materials_unlit"],
    }
    _write(path, root, body)


def write_colored_glb(
    path: Path, vertices: NDArray[np.floating], triangles: NDArray[np.integer], colors: NDArray[np.uint8], name: str
) -> None:
    """Writes a mesh with a color per vertex atomically, without lighting.

    vertices   (N, 3) meters in glTF's frame, y up
    triangles  (M, 3)
    colors     (N, 3) RGB, written as they are

    Raises InputError if the disk refuses.
    """
    places = np.asarray(vertices, "<f4")
    rgba = np.concatenate([colors, np.full((len(colors), 1), 255, np.uint8)], axis=1)
    blobs = [places.tobytes(), rgba.tobytes(), np.asarray(triangles, "<u4").tobytes()]
    views, body = _buffer(blobs, (_VERTICES, _VERTICES, _INDICES))
    attributes = {"POSITION": 0, "COLOR_0": 1}
    root = {
        "asset": {"version": "2.0", "generator": "NVSim"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [{"name": name, "primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _FLOAT,
                "count": len(places),
                "type": "VEC3",
                "min": places.min(axis=0).tolist(),
                "max": places.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": _UINT8, "normalized": True, "count": len(rgba), "type": "VEC4"},
            {"bufferView": 2, "componentType": _UINT32, "count": int(np.size(triangles)), "type": "SCALAR"},
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(body)}],
        "extensionsUsed": ["KHR_materials_unlit"],
    }
    _write(path, root, body)


def _buffer(blobs: Sequence[bytes], targets: Sequence[int | None]) -> tuple[list[dict[str, Any]], bytes]:
    """Returns the buffer views of blobs, and the buffer."""
    views: list[dict[str, Any]] = []
    parts, offset = [], 0
    for blob, target in zip(blobs, targets, strict=True):
        view = {"buffer": 0, "byteOffset": offset, "byteLength": len(blob)}
        views.append(view if target is None else {**view, "target": target})
        parts.append(blob + b"\0" * (-len(blob) % 4))
        offset += len(parts[-1])
    return views, b"".join(parts)


def _write(path: Path, root: dict[str, Any], body: bytes) -> None:
    text = json.dumps(root, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), _JSON) + text + struct.pack("<I4s", len(body), _BIN) + body
    atomic.write_bytes(path, struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
