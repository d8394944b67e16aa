"""How far the agent may go: its flags."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.errors import InputError


@dataclass(frozen=True)
class Rules:
    """How far the agent mapgpt may go."""

    steps: int = 15
    """Most questions of an episode."""
    stop_after: int = 3
    """Steps before which stopping is not offered; R2R's paths have four or more."""
    most_images: int = 20
    """Most images of a question: of the places that can be gone to, then of others, those seen last first."""

    def __post_init__(self) -> None:
        limits = (
            ("--steps", self.steps, 1),
            ("--stop-after", self.stop_after, 0),
            ("--most-images", self.most_images, 1),
        )
        for flag, value, least in limits:
            if not least <= value <= 1000:
                raise InputError(f"{flag} {value} is out of range; give {least} to 1000.")
