"""Evidence on demand: remembered where it was measured before, rendered where it was not."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from nvsim.graph.types import Evidence, Viewpoint
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import (
    DIRECTIONS,
    Corridor,
    FloorView,
    HeightAt,
    SupportAt,
    look_down,
    measure,
    view_of,
)
from nvsim.mapping.criteria import answers
from nvsim.mapping.lattice import Lattice
from nvsim.mapping.view_source import ViewSource

_SAME_FLOOR = 0.5  # metres


class Measurements:
    """rendered_viewpoints  viewpoints that a whole turn was rendered at
    rendered_views       single views, those of the turns included
    """

    def __init__(
        self,
        source: ViewSource,
        floor_at: HeightAt,
        support: SupportAt,
        config: MappingConfig,
        lattice: Lattice,
        remembered: Iterable[Evidence] = (),
    ) -> None:
        self._source, self._floor_at, self._support, self._config = source, floor_at, support, config
        self._lattice = lattice
        self._steps: dict[tuple[str, int], Evidence] = {}
        self._joins: dict[tuple[str, str], Evidence] = {}
        for evidence in remembered:
            if evidence.joins:
                self._joins[evidence.viewpoint, evidence.joins] = evidence
            else:
                self._steps[evidence.key] = evidence
        self._views: tuple[str, dict[int, FloorView]] = ("", {})
        self.rendered_viewpoints = 0
        self.rendered_views = 0

    def around(self, viewpoint: Viewpoint, others: Iterable[Viewpoint] = ()) -> list[Evidence]:
        """The evidence of the eight lattice directions. Corridors to `others` may be asked for next: what they are read
        from is rendered along."""
        found = [self._steps.get((viewpoint.id, k)) for k in range(DIRECTIONS)]
        corridors = [self._step(viewpoint, k) for k in range(DIRECTIONS)]
        known = [e for e, c in zip(found, corridors, strict=True) if e is not None and self._holds(e, c)]
        if len(known) == DIRECTIONS:
            return known
        wanted = {k: [corridor] for k, corridor in enumerate(corridors)}
        for other in others:
            if other.id != viewpoint.id:
                towards = _corridor(viewpoint, other.position[:2])
                wanted[view_of(towards, self._config)].append(towards)
        views = look_down(self._source, np.array(viewpoint.position), wanted, self._floor_at, self._config)
        self._views = (viewpoint.id, views)
        self.rendered_viewpoints += 1
        self.rendered_views += DIRECTIONS
        measured = []
        for k, corridor in enumerate(corridors):
            evidence = measure(views[k], viewpoint.id, k, corridor, self._floor_at, self._support)
            self._steps[evidence.key] = evidence
            measured.append(evidence)
        return measured

    def between(self, viewpoint: Viewpoint, other: Viewpoint) -> Evidence:
        """The evidence of the corridor from one viewpoint to another; its direction is -1, for the caller to number."""
        corridor = _corridor(viewpoint, other.position[:2])
        found = self._joins.get((viewpoint.id, other.id))
        if found is not None and self._holds(found, corridor):
            return found
        k = view_of(corridor, self._config)
        owner, views = self._views
        view = views[k] if owner == viewpoint.id else None
        if view is None or not view.shows(corridor, self._floor_at):
            place = np.array(viewpoint.position)
            view = look_down(self._source, place, {k: [corridor]}, self._floor_at, self._config)[k]
            self.rendered_views += 1
        evidence = measure(view, viewpoint.id, -1, corridor, self._floor_at, self._support, other.id)
        if abs(corridor.end(self._floor_at) - float(self._floor_at(np.array(other.position)))) > _SAME_FLOOR:
            evidence = replace(evidence, support=np.zeros_like(evidence.support))  # it ends beneath or over the other
        self._joins[viewpoint.id, other.id] = evidence
        return evidence

    def everything(self) -> tuple[Evidence, ...]:
        """All evidence measured or remembered so far; corridors to other viewpoints are numbered from 8."""
        joins = enumerate(self._joins.values(), DIRECTIONS)
        return (*self._steps.values(), *(replace(e, direction=i) for i, e in joins))

    def _step(self, viewpoint: Viewpoint, k: int) -> Corridor:
        return _corridor(viewpoint, self._lattice.target(viewpoint.id, k))

    def arrival(self, viewpoint: Viewpoint, target: tuple[float, float]) -> tuple[float, float, float]:
        """World x, y, z of the camera that has gone from a viewpoint to `target` (x, y), as high above the floor."""
        return *target, _corridor(viewpoint, target).end(self._floor_at) + viewpoint.height

    def _holds(self, evidence: Evidence, corridor: Corridor) -> bool:
        return answers(evidence, corridor.length, corridor.heading, self._config)


def _corridor(viewpoint: Viewpoint, target: tuple[float, float]) -> Corridor:
    return Corridor(viewpoint.position[:2], target, viewpoint.position[2])
