"""Limits of the agent: its flags."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError


@dataclass(frozen=True)
class Rules:
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
