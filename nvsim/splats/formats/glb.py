"""Write a textured floor as glTF 2.0 in one binary file (Khronos, glTF 2.0 specification, section 4: GLB)."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np

from nvsim.files import atomic
from nvsim.splats.floor_mesh import FloorMesh

_FLOAT, _UINT32 = 5126, 5125
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
    views, body = [], b""
    for blob, target in zip(blobs, (_VERTICES, _VERTICES, _INDICES, None), strict=True):
        view = {"buffer": 0, "byteOffset": len(body), "byteLength": len(blob)}
        views.append(view if target is None else {**view, "target": target})
        body += blob + b"\0" * (-len(blob) % 4)
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
    text = json.dumps(root, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), _JSON) + text + struct.pack("<I4s", len(body), _BIN) + body
    atomic.write_bytes(path, struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
