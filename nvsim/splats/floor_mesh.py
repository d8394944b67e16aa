"""Export the floor of a submap model as a textured mesh for programs without a background model, as glTF 2.0 in one
binary file.

The color that a person nearby would see at each point is baked into the texture.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.splats import harmonics
from nvsim.splats.types import SubmapModel

EYE_HEIGHT = 1.5
"""Height in meters above the floor of the eyes for which colors are baked..."""
AWAY = 2.0
"""...their horizontal distance in meters..."""
HEADINGS = 8
"""...and the number of directions that are averaged."""
SHADE_SPACING = 0.5
"""Meters between the points at which the background network is evaluated. Colors between them are interpolated."""
LARGEST_CELL = 0.5
"""Meters: largest side of the mesh's rectangles if the floor is not flat."""


@dataclass(frozen=True, eq=False)
class FloorMesh:
    """A textured mesh in world x, y, z up, meters.

    vertices    (V, 3) float32
    uvs         (V, 2) float32, 0 to 1; u follows x, v follows y, (0, 0) is the corner of image row 0, column 0
    triangles   (T, 3) uint32, counter-clockwise seen from above
    image       (rows, columns, 4) uint8, RGB and whether the floor is known at the pixel (255) or not (0); row follows
                y
    """

    vertices: NDArray[np.float32]
    uvs: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    image: NDArray[np.uint8]


def floor_mesh(model: SubmapModel) -> FloorMesh | None:
    """The floor below the texture of `model`. None if the model has no texture."""
    if model.texture is None or not model.texture.levels:
        return None
    low, high = np.array(model.texture.low), np.array(model.texture.high)
    vertices, uvs, triangles = _surface(model.floor, low, high)
    return FloorMesh(vertices, uvs, triangles, _picture(model, low, high))


def _surface(
    floor: FloorSurface, low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]:
    cells = np.ones(2, np.int64) if floor.heights.size == 1 else np.ceil((high - low) / LARGEST_CELL).astype(np.int64)
    u, v = np.meshgrid(np.linspace(0, 1, cells[0] + 1), np.linspace(0, 1, cells[1] + 1))
    uvs = np.stack([u, v], axis=-1).reshape(-1, 2)
    xy = low + uvs * (high - low)
    vertices = np.column_stack([xy, floor.height_at(xy)])
    corner = np.arange(u.size).reshape(u.shape)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    triangles = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2).reshape(-1, 3)
    return vertices.astype(np.float32), uvs.astype(np.float32), triangles.astype(np.uint32)


def _picture(model: SubmapModel, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.uint8]:
    assert model.texture is not None
    levels = model.texture.levels
    rows, columns = max(levels, key=lambda level: level.size).shape[:2]

    def fitted(image: NDArray[np.float32], how: int = cv2.INTER_LINEAR) -> NDArray[np.float32]:
        return np.asarray(cv2.resize(image, (columns, rows), interpolation=how), np.float32)

    colour = fitted(_shade(model, low, high))
    known = np.zeros((rows, columns), np.bool_)
    for index, level in enumerate(levels):
        colour += fitted(level)
        if index > 0 or len(levels) == 1:  # the coarsest texels extend far beyond the observed floor
            # Texels that no image shows keep their initial value 0.
            touched = np.asarray(level.any(axis=2), np.float32)
            known |= fitted(touched, cv2.INTER_NEAREST) > 0
    image = np.empty((rows, columns, 4), np.uint8)
    image[..., :3] = np.round(255 * np.clip(colour, 0, 1))
    image[..., 3] = 255 * known
    return image


def _shade(model: SubmapModel, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float32]:
    """(rows, columns, 3) the background's color at points of the floor, averaged over eyes around each point."""
    columns, rows = np.maximum(np.round((high - low) / SHADE_SPACING).astype(np.int64), 1)
    shade = np.zeros((rows, columns, 3), np.float32)
    if model.background is None:
        return shade
    x = low[0] + (np.arange(columns) + 0.5) * (high[0] - low[0]) / columns
    y = low[1] + (np.arange(rows) + 0.5) * (high[1] - low[1]) / rows
    heights = model.floor.height_at(np.stack(np.meshgrid(x, y), axis=-1))
    angles = 2 * np.pi * np.arange(HEADINGS) / HEADINGS
    offsets = np.column_stack([AWAY * np.sin(angles), AWAY * np.cos(angles), np.full(HEADINGS, EYE_HEIGHT)])
    looks = harmonics.basis(-offsets / np.linalg.norm(offsets, axis=1, keepdims=True), 4)
    for r in range(rows):
        for c in range(columns):
            spot = np.array([x[c], y[r], heights[r, c]])
            seen = [look @ model.background.coefficients(spot + o) for look, o in zip(looks, offsets, strict=True)]
            shade[r, c] = np.mean(seen, axis=0)
    return shade


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
