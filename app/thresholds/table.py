"""The thresholds that can be decided again from stored evidence, with their ranges. Does not use Qt."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.mapping import criteria
from nvsim.mapping.config import WIDEST, MappingConfig


@dataclass(frozen=True)
class Threshold:
    """One slider.

    field       of MappingConfig
    name, unit  for the user; unit "" for a share
    low, high   range of the slider
    step        of the slider and of its number
    worst_only  whether only the rule "worst" uses it
    family      criterion that must be selected for it to decide; "" if it always decides
    """

    field: str
    name: str
    low: float
    high: float
    step: float = 0.01
    unit: str = ""
    worst_only: bool = False
    family: str = ""

    def of(self, config: MappingConfig) -> float:
        return float(getattr(config, self.field))

    @property
    def steps(self) -> int:
        return round((self.high - self.low) / self.step)

    def to_step(self, value: float) -> int:
        return min(max(round((value - self.low) / self.step), 0), self.steps)

    def to_value(self, step: int) -> float:
        # Rounded, so that 0.95 is not displayed as a neighboring float.
        return round(self.low + step * self.step, 6)


def thresholds() -> tuple[Threshold, ...]:
    """One threshold for each criterion, then those of the robot and the trajectory."""
    return (
        *(Threshold(c.field, c.label, 0.0, 1.0, worst_only=c.worst_only, family=c.family) for c in criteria.CRITERIA),
        Threshold("robot_radius", "Robot's radius", 0.0, 0.45, unit="m"),
        Threshold("margin", "Margin on each side", 0.0, 0.2, unit="m"),
        Threshold("max_distance", "Distance to trajectory", 0.0, 10.0, 0.1, "m"),
    )


FIXED = (
    *("tau_dist", "merge_radius", "checked_merges", "start", "starts", "isolated", "cover_distance", "max_viewpoints"),
    *("standing", "lattice_offset", "jitter", "settle", "reach", "stretch", "around", "view_size", "second_opinion"),
    *("views", "panorama_width", "normals_model", "photographed"),
)
"""Settings that determine the places or renders of viewpoints. The evidence cannot decide other values of them."""


def changed(config: MappingConfig, field: str, value: bool | float | str | tuple[str, ...]) -> MappingConfig:
    """`config` with another value. If the robot would be too wide for the evidence, reduces its margin or radius."""
    values = {**vars(config), field: value}
    other = {"robot_radius": "margin", "margin": "robot_radius"}.get(field)
    if other is not None and isinstance(value, int | float):
        values[other] = round(max(0.0, min(values[other], WIDEST / 2 - value)), 6)
    return MappingConfig(**values)


def preset(config: MappingConfig, like: MappingConfig) -> MappingConfig:
    """`config` with the thresholds of `like`. Settings that cannot be decided again keep their values."""
    return MappingConfig(**{name: getattr(config if name in FIXED else like, name) for name in vars(config)})
