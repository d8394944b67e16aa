"""Several splat files of one building as one. Each line of a text file NAME.splats names a file and its transform. The
index of a streamed SOG names files without transforms."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import read_text
from nvsim.splats.formats.sog import INDEX, level_to_read
from nvsim.splats.turning import transform_gaussians
from nvsim.splats.types import Gaussians, joined

SUFFIX = ".splats"
_WHAT, _THEN = (
    "a list of splat files",
    "write the path of a splat file and the 12 numbers of its transform on each line",
)
_LONGEST = 1_000_000  # bytes
_MOST = 100  # files
_NUMBERS = (16, 12)  # of a transform: with its last row, and without
_EXACT = 1e-3  # relative error of the numbers of a transform


@dataclass(frozen=True, eq=False)
class ListedSplats:
    """path         of the splat file
    rotation     (3, 3) proper rotation
    scale        positive
    translation  (3,): a point x of the file is scale * rotation @ x + translation in the building
    """

    path: Path
    rotation: NDArray[np.float64]
    scale: float
    translation: NDArray[np.float64]

    def placed(self, gaussians: Gaussians, coefficients: int) -> Gaussians:
        """The Gaussians of the file in the frame of the building, with so many coefficients per color channel. New
        coefficients are 0."""
        found = transform_gaussians(gaussians, self.rotation, self.scale)
        means = found.means.astype(np.float64) + self.translation
        sh = np.zeros((len(found), coefficients, 3), np.float32)
        sh[:, : found.sh.shape[1]] = found.sh
        return Gaussians(means.astype(np.float32), found.log_scales, found.quats, found.opacity_logits, sh)


def is_list(path: Path) -> bool:
    """Whether the file name is that of a list of splat files, or of the index of a streamed SOG."""
    return path.suffix.lower() == SUFFIX or path.name == INDEX


def listed_splats(path: Path) -> list[ListedSplats]:
    """The files that the list at `path` names. Relative paths start at its folder; text after # is a comment. Of a
    streamed SOG, those of one level of detail, see `level_to_read`.

    Raises InputError naming the line if the list cannot be read, names no file, more than 100 files, or a file twice,
    or if a transform is not a rotation with a uniform scale and a translation."""
    if path.name == INDEX:
        return [ListedSplats(file, np.eye(3), 1.0, np.zeros(3)) for file in level_to_read(path).files]
    found: list[ListedSplats] = []
    for number, line in enumerate(read_text(path, _WHAT, _THEN, _LONGEST).splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        where = f"{path}, line {number}"
        name, numbers = _split_line(where, line.partition("#")[0].strip())
        file = path.parent / name
        if is_list(file):
            raise InputError(f"{where}: {name[:80]} is itself a list; name its files instead.")
        if any(file == one.path for one in found):
            raise InputError(f"{where}: {name[:80]} is named twice; remove one of the lines.")
        found.append(ListedSplats(file, *_transform(where, numbers)))
    if not found:
        raise InputError(f"{path} names no splat file; {_THEN}.")
    if len(found) > _MOST:
        raise InputError(f"{path} names {len(found)} splat files; at most {_MOST} are read together.")
    return found


def join_splats(listed: list[ListedSplats], contents: list[Gaussians]) -> Gaussians:
    """The Gaussians of all files in the frame of the building. `contents` are those of the files in their own
    frames."""
    coefficients = max(one.sh.shape[1] for one in contents)
    return joined(*(one.placed(each, coefficients) for one, each in zip(listed, contents, strict=True)))


def _split_line(where: str, text: str) -> tuple[str, list[float]]:
    """The path and the numbers of a line. A path can contain spaces."""
    for count in _NUMBERS:
        words = text.rsplit(maxsplit=count)
        numbers = [value for value in map(_number, words[1:]) if value is not None]
        if len(words) == count + 1 and len(numbers) == count:
            return words[0], numbers
    if _number(text.split()[-1]) is not None:
        raise InputError(f"{where} does not have 12 or 16 numbers after the path; {_THEN}.")
    return text, []


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _transform(where: str, numbers: list[float]) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
    """Rotation (3, 3), scale, and translation (3,) of the rows of a 3x4 or 4x4 matrix. No numbers are the identity."""
    matrix = np.array(numbers or np.eye(4)[:3].ravel().tolist()).reshape(-1, 4)
    linear = matrix[:3, :3]
    determinant = float(np.linalg.det(linear)) if np.abs(matrix).max() < 1e6 else float("nan")
    if not determinant > 1e-12:
        raise InputError(
            f"{where}: the transform has no positive scale, is a mirror image, or has numbers above 1e6; {_THEN}."
        )
    scale = determinant ** (1 / 3)
    left, _, right = np.linalg.svd(linear / scale)
    rotation = left @ right
    if np.abs(linear / scale - rotation).max() > _EXACT or not np.allclose(matrix[3:], [0.0, 0.0, 0.0, 1.0]):
        raise InputError(
            f"{where}: the transform is not a rotation with a uniform scale and a translation; write the rows of such "
            "a matrix."
        )
    return rotation, scale, matrix[:3, 3]
