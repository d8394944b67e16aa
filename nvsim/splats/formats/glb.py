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
    half = float(np.sqrt(0.5))
    uvs = {"componentType": _FLOAT, "count": len(mesh.uvs), "type": "VEC2"}
    root = _scene(name, mesh.vertices, {"TEXCOORD_0": uvs}, mesh.triangles.size)
    root["nodes"][0]["rotation"] = [-half, 0.0, 0.0, half]
    root["materials"][0] |= {"name": "floor", "alphaMode": "MASK"}
    root["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    root["textures"] = [{"source": 0, "sampler": 0}]
    root["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}]
    root["images"] = [{"bufferView": 3, "mimeType": "image/png"}]
    _write(path, root, blobs, (_VERTICES, _VERTICES, _INDICES, None))


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
    color = {"componentType": _UINT8, "normalized": True, "count": len(rgba), "type": "VEC4"}
    root = _scene(name, places, {"COLOR_0": color}, int(np.size(triangles)))
    _write(path, root, blobs, (_VERTICES, _VERTICES, _INDICES))


def _scene(
    name: str, vertices: NDArray[np.floating], attribute: dict[str, dict[str, Any]], corners: int
) -> dict[str, Any]:
    """The root of one mesh without lighting: its vertices (N, 3), one further attribute, and the corners of its
    triangles, each in the buffer view of the same number."""
    (kind, accessor), corner = next(iter(attribute.items())), {"componentType": _UINT32, "count": corners}
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    place = {"componentType": _FLOAT, "count": len(vertices), "type": "VEC3", "min": low, "max": high}
    accessors = (place, accessor, {**corner, "type": "SCALAR"})
    return {
        "asset": {"version": "2.0", "generator": "NVSim"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [
            {"name": name, "primitives": [{"attributes": {"POSITION": 0, kind: 1}, "indices": 2, "material": 0}]}
        ],
        "accessors": [{"bufferView": number, **one} for number, one in enumerate(accessors)],
        "materials": [
            {
                "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0},
                "doubleSided": True,
                "extensions": {"KHR_materials_unlit": {}},
            }
        ],
        "extensionsUsed": ["KHR_materials_unlit"],
    }


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


def _write(path: Path, root: dict[str, Any], blobs: Sequence[bytes], targets: Sequence[int | None]) -> None:
    views, body = _buffer(blobs, targets)
    root |= {"bufferViews": views, "buffers": [{"byteLength": len(body)}]}
    text = json.dumps(root, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), _JSON) + text + struct.pack("<I4s", len(body), _BIN) + body
    atomic.write_bytes(path, struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
