"""What a user can say about the cutting of panoramas into views: how many, and which part of them is ignored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.reading import as_reading_error
from nvsim.footage.sources import Footage, Stamp, is_panoramic

MASKS = "masks"
"""The folder of masks beside that of the images, where readers of COLMAP models look for them."""
WHOLE = "panorama.png"
"""Among the masks: that of the equirectangular images."""
VIEWS = 4
"""Views of a panorama if the user gives no number."""
TILTS: dict[int, tuple[float, ...]] = {4: (0.0,), 8: (0.0, -45.0), 12: (0.0, -45.0, 45.0)}
"""Degrees above the horizon of each ring of four views, by the number of views. Level views end 35 to 45 degrees below
the horizon; the second ring covers the floor down to the foot of the camera, and the third the ceiling."""


@dataclass(frozen=True)
class CutOptions:
    """What the user gave.

    views  of each panorama, None for the usual number
    mask   an equirectangular image in which black is ignored, None to find the carrier of the camera
    """

    views: int | None = None
    mask: Path | None = None

    @property
    def count(self) -> int:
        """Views of each equirectangular image."""
        return VIEWS if self.views is None else self.views

    @property
    def stamp(self) -> Stamp:
        """Of the mask, empty without one. Raises InputError if it is missing."""
        if self.mask is None:
            return ()
        try:
            stat = self.mask.stat()
        except OSError as error:
            raise as_reading_error(self.mask, error) from error
        return ((str(self.mask.absolute()), stat.st_size, stat.st_mtime_ns),)

    def agrees(self, views: int, mask: Stamp, sides: int = 0) -> bool:
        """Whether panoramas that were cut into `views` with the mask of the stamp `mask` are what these options give.
        `sides` is the number of videos of a rig, which are the views."""
        return views == (sides or self.count) and mask == self.stamp


def cut_options(views: int | None, mask: str) -> CutOptions | None:
    """The values of --views and --mask, None if the user gave neither. Raises InputError for a number of views that has
    no meaning, and for a mask that is missing."""
    if views is None and not mask:
        return None
    if views is not None and views not in TILTS:
        raise InputError(
            f"A panorama cannot be cut into {views} views; --views is 4 (level), 8 (with four that look down) or 12 "
            "(with four more that look up)."
        )
    options = CutOptions(views, Path(mask).expanduser().absolute() if mask else None)
    assert options.stamp is not None  # a missing mask is refused here
    return options


def refuse_unless_cut(footage: Footage, options: CutOptions) -> None:
    """Raises InputError if the footage is not cut into views, so that the options do not apply."""
    if not is_panoramic(footage):
        raise not_panoramic(footage.source)
    if footage.sides and options.views is not None:
        raise InputError(
            f"The videos in {footage.source} are the views of a 360 degree rig already; leave --views out."
        )


def refuse_replaced(options: CutOptions | None, folder: Path) -> None:
    """Raises InputError if the mask is among those in the capture `folder`, which are replaced."""
    if options is not None and options.mask is not None and (folder / MASKS).absolute() in options.mask.parents:
        raise InputError(f"{options.mask} is in a folder of masks that are replaced; copy it and name the copy.")


def not_panoramic(source: Path) -> InputError:
    return InputError(f"{source} is no 360 degree capture, so --views and --mask do not apply; leave them out.")
