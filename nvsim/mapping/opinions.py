"""What was measured along one corridor, by each submap model that was asked."""

from __future__ import annotations

from dataclasses import replace

from nvsim.graph.types import Evidence, SecondOpinion
from nvsim.mapping.config import MappingConfig


def opinions(evidence: Evidence, config: MappingConfig) -> tuple[Evidence, ...]:
    """The evidence of the model that draws the viewpoint, and, where `config` asks for it and it was measured, that of
    another."""
    other = evidence.second
    if other is None or not config.second_opinion:
        return (evidence,)
    second = replace(
        evidence,
        submap=other.submap,
        alpha=other.alpha,
        up=other.up,
        reach=other.reach,
        mass=other.mass,
        network_up=other.network_up,
        second=None,
    )
    return evidence, second


def joined(first: Evidence, second: Evidence) -> Evidence:
    """The evidence of one model with that of another, of the same corridor, as its second opinion."""
    other = SecondOpinion(second.submap, second.alpha, second.up, second.reach, second.mass, second.network_up)
    return replace(first, second=other)
