"""Options for cutting panoramas into views: the number of views, and the ignored part of the image."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.reading import as_reading_error
from nvsim.footage.sources import Footage, Stamp, is_panoramic

MASKS = "masks"
"""The folder of masks next to the image folder, where readers of COLMAP models expect it."""
WHOLE = "panorama.png"
"""File name of the mask of the equirectangular images, in the mask folder."""
VIEWS = 4
"""Views of a panorama if the user gives no number."""
TILTS: dict[int, tuple[float, ...]] = {4: (0.0,), 8: (0.0, -45.0), 12: (0.0, -45.0, 45.0)}
"""Elevations in degrees of the rings of four views, by the number of views. Horizontal views end 35 to 45 degrees below
the horizon. The second ring covers the floor down to the foot of the camera, and the third ring covers the ceiling."""


@dataclass(frozen=True)
class CutOptions:
    """Options that the user gave.

    views  views of each panorama, None for the default number
    mask   equirectangular image in which ignored pixels are black, None to find the carrier of the camera automatically
    """

    views: int | None = None
    mask: Path | None = None

    @property
    def count(self) -> int:
        """Number of views of each equirectangular image."""
        return VIEWS if self.views is None else self.views

    @property
    def stamp(self) -> Stamp:
        """The stamp of the mask file, empty without a mask. Raises InputError if the file is missing."""
        if self.mask is None:
            return ()
        try:
            stat = self.mask.stat()
        except OSError as error:
            raise as_reading_error(self.mask, error) from error
        return ((str(self.mask.absolute()), stat.st_size, stat.st_mtime_ns),)

    def agrees(self, views: int, mask: Stamp, sides: int = 0) -> bool:
        """Whether panoramas cut into `views` with a mask of stamp `mask` agree with these options. `sides` is the
        number of videos of a 360 degree rig, or 0; for a rig, the videos are the views."""
        return views == (sides or self.count) and mask == self.stamp


def cut_options(views: int | None, mask: str) -> CutOptions | None:
    """The values of --views and --mask, None if the user gave neither. Raises InputError if the number of views is not
    supported, or if the mask is missing."""
    if views is None and not mask:
        return None
    if views is not None and views not in TILTS:
        raise InputError(
            f"A panorama cannot be cut into {views} views; --views is 4 (level), 8 (with four that look down) or 12 "
            "(with four more that look up)."
        )
    options = CutOptions(views, Path(mask).expanduser().absolute() if mask else None)
    assert options.stamp is not None  # raises InputError if the mask is missing
    return options


def refuse_unless_cut(footage: Footage, options: CutOptions) -> None:
    """Raises InputError if these options do not apply because the footage is not cut into views."""
    if not is_panoramic(footage):
        raise not_panoramic(footage.source)
    if footage.sides and options.views is not None:
        raise InputError(f"The videos in {footage.source} are the views of a 360 degree rig already; omit --views.")


def refuse_mask_in_output(options: CutOptions | None, folder: Path) -> None:
    """Raises InputError if the mask is in the mask folder of the capture `folder`, which is replaced."""
    if options is not None and options.mask is not None and (folder / MASKS).absolute() in options.mask.parents:
        raise InputError(f"{options.mask} is in a mask folder that is replaced; copy it elsewhere and use the copy.")


def not_panoramic(source: Path) -> InputError:
    """The error for options of panoramas with footage that is not panoramic."""
    return InputError(f"{source} is not a 360 degree capture, so --views and --mask do not apply; omit them.")
