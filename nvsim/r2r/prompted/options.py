"""Options of the commands that ask a model: the images that are sent, and the limits of the agent mapgpt."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError


@dataclass(frozen=True)
class ImageOptions:
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


@dataclass(frozen=True)
class EpisodeLimits:
    """Limits of the agent mapgpt."""

    steps: int = 15
    """Largest number of questions in an episode."""
    stop_after: int = 3
    """Number of steps before stopping is offered; R2R's paths have four or more edges."""
    most_images: int = 20
    """Largest number of images in a question: first of the neighbors, then of other places, the last seen first."""

    def __post_init__(self) -> None:
        limits = (
            ("--steps", self.steps, 1),
            ("--stop-after", self.stop_after, 0),
            ("--most-images", self.most_images, 1),
        )
        for flag, value, least in limits:
            if not least <= value <= 1000:
                raise InputError(f"{flag} {value} is out of range; give {least} to 1000.")
