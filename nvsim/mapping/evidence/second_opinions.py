"""The evidence of one corridor, by each submap model that was used."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence, SecondOpinion

if TYPE_CHECKING:
    from nvsim.mapping.config import MappingConfig


def opinions(evidence: Evidence, config: MappingConfig) -> tuple[Evidence, ...]:
    """Return the evidence of the model that renders the viewpoint. The evidence of another model follows if `config`
    uses it and it was measured."""
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


def with_second_opinion(first: Evidence, second: Evidence, strange: NDArray[np.bool_]) -> Evidence:
    """Return the evidence of one model, with that of another model of this corridor as its second opinion. In `strange`
    (rows, cells), where the other model was not trained, the values of the first are used for both."""

    def only_where_strange(one: NDArray[np.uint8] | None, other: NDArray[np.uint8] | None) -> NDArray[np.uint8] | None:
        return None if one is None or other is None else np.where(strange, one, other).astype(np.uint8)

    other = SecondOpinion(
        second.submap,
        np.where(strange, first.alpha, second.alpha).astype(np.uint8),
        np.where(strange, first.up, second.up).astype(np.uint8),
        only_where_strange(first.reach, second.reach),
        only_where_strange(first.mass, second.mass),
        only_where_strange(first.network_up, second.network_up),
    )
    return replace(first, second=other)
