"""Options for the images that are sent: the flags of every command that shows views of a scan to a model."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError


@dataclass(frozen=True)
class Looking:
    """The images that are sent."""

    image_width: int = 640
    """Pixels of the images that are sent; they are three quarters as high."""
    field_of_view: float = 60.0
    """Vertical field of view of these images in degrees; R2R's views have 60."""

    def __post_init__(self) -> None:
        if not 32 <= self.image_width <= 4096:
            raise InputError(f"--image-width {self.image_width} is out of range; give 32 to 4096 pixels.")
        if not 10 <= self.field_of_view <= 120:
            raise InputError(f"--field-of-view {self.field_of_view:g} is out of range; give 10 to 120 degrees.")

    @property
    def image_height(self) -> int:
        return max(1, round(self.image_width * 0.75))
