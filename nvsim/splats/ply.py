"""Gaussians as a PLY file in the layout of the INRIA reference program, which every splat viewer reads: f_dc and f_rest
(channel after channel), opacity as logit, scale as logarithm, rot as w x y z, all float32."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsim import atomic
from nvsim.capture.ply import parse
from nvsim.errors import InputError
from nvsim.splats.types import Gaussians

_REST_OF_DEGREE = {0: 0, 1: 9, 2: 24, 3: 45}
_MEAN, _DC = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2")
_SCALE, _ROTATION = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
_NORMAL = ("nx", "ny", "nz")  # always zero; some readers count on them
_ANTIALIASED = {"antialiased 1": True, "antialiased 0": False}
_BRUSH_MODES = {"SplatRenderMode: mip": True, "SplatRenderMode: default": False}


def write_ply(path: Path, gaussians: Gaussians, antialiased: bool) -> None:
    """Whole or not at all. The comment "antialiased 0|1" tells how the Gaussians must be drawn.

    Raises InputError when the disk refuses.
    """
    g = gaussians
    n, rest = len(g), 3 * (g.sh.shape[1] - 1)
    names = [*_MEAN, *_NORMAL, *_DC, *(f"f_rest_{i}" for i in range(rest)), "opacity", *_SCALE, *_ROTATION]
    table = np.concatenate(
        [
            g.means,
            np.zeros((n, 3), np.float32),
            g.sh[:, 0],
            g.sh[:, 1:].transpose(0, 2, 1).reshape(n, rest),
            g.opacity_logits[:, None],
            g.log_scales,
            g.quats,
        ],
        axis=1,
        dtype="<f4",
    )
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment antialiased {int(antialiased)}",
        "comment Vertical Axis: z",
        f"element vertex {n}",
        *(f"property float {name}" for name in names),
        "end_header",
    ]
    with atomic.replacing(path) as temporary, open(temporary, "wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        table.tofile(file)


def read_ply(path: Path) -> tuple[Gaussians, bool | None]:
    """The Gaussians, and whether the file says that they are to be drawn antialiased (None when it does not say).

    Properties may come in any order and with others between them; normals may be missing. Raises InputError naming the
    file and what is wrong with it.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"Cannot read {path}: {error.strerror or error}; check the path.") from error
    if not data.startswith(b"ply"):
        raise InputError(f"{path} does not begin as a PLY file does; choose a PLY file of Gaussians.")
    columns = parse(path, data)
    missing = [n for n in (*_MEAN, *_DC, "opacity", *_SCALE, *_ROTATION) if n not in columns]
    if missing:
        raise InputError(
            f"{path} has no property {', '.join(missing[:4])}{' ...' if len(missing) > 4 else ''}, so it holds no"
            " Gaussians; export it in the layout of the INRIA program."
        )
    rest = sum(name.startswith("f_rest_") for name in columns)
    if rest not in _REST_OF_DEGREE.values() or any(f"f_rest_{i}" not in columns for i in range(rest)):
        raise InputError(
            f"{path} has {rest} properties f_rest_*, but spherical harmonics of degree 0 to 3 have"
            " 0, 9, 24 or 45 of them (f_rest_0 and on); export it with degree 3 or less."
        )

    def stacked(names: tuple[str, ...]) -> np.ndarray:
        if not names:
            return np.zeros((len(columns["x"]), 0), np.float32)
        return np.stack([np.asarray(columns[n], np.float32) for n in names], axis=1)

    n, coefficients = len(columns["x"]), rest // 3
    higher = stacked(tuple(f"f_rest_{i}" for i in range(rest))).reshape(n, 3, coefficients).transpose(0, 2, 1)
    gaussians = Gaussians(
        stacked(_MEAN),
        stacked(_SCALE),
        stacked(_ROTATION),
        np.array(columns["opacity"], np.float32),
        np.ascontiguousarray(np.concatenate([stacked(_DC)[:, None], higher], axis=1)),
    )
    g = gaussians
    finite = np.ones(n, bool)
    for array in (g.means, g.log_scales, g.quats, g.opacity_logits, g.sh):
        finite &= np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    if not finite.all():
        first = int(np.argmin(finite))
        raise InputError(
            f"{path} holds {n - int(finite.sum())} Gaussians with values that are not finite, the first is number"
            f" {first}; export it again without them."
        )
    return gaussians, _render_mode(data)


def _render_mode(data: bytes) -> bool | None:
    header = data[: data.find(b"end_header")].decode("ascii", "replace")
    for line in header.splitlines():
        text = line.removeprefix("comment ").strip()
        for known in (_ANTIALIASED, _BRUSH_MODES):
            if text in known:
                return known[text]
    return None
