"""Evidence on demand: reused if it was measured already, otherwise rendered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence, Viewpoint
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import (
    DIRECTIONS,
    Corridor,
    HeightAt,
    Lattice,
    SupportAt,
    evidence_without_obstacles,
    view_of,
)
from nvsim.mapping.criteria import OPEN, decide, is_sufficient
from nvsim.mapping.evidence.second_opinions import with_second_opinion
from nvsim.mapping.evidence.traversed_floor import CLIMB, TraversedFloor, out_of_sight
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.mapping.views.floor_view import FloorView, measure
from nvsim.mapping.views.view_sources import MultiModelSource, ViewSource, render_pitched_views

if TYPE_CHECKING:
    from nvsim.mapping.slice_mass import SliceGaussians

_SAME_FLOOR = 0.5  # meters
_KEPT = 1 << 22  # maximum pixels of the cached views of recent viewpoints, if a network needs whole views


class Measurements:
    """Measures corridors and stores their evidence.

    rendered_viewpoints  viewpoints at which all eight directions were rendered
    rendered_views       single views or panoramas, including those of second opinions
    """

    def __init__(
        self,
        source: ViewSource,
        floor_at: HeightAt,
        support: SupportAt,
        config: MappingConfig,
        lattice: Lattice,
        remembered: Iterable[Evidence] = (),
        traversed: TraversedFloor | None = None,
    ) -> None:
        """`remembered` is the evidence of earlier builds. `traversed` is the floor over which the camera was carried.
        It counts as free near stairs, which few views show, and everywhere if there is no LiDAR scan."""
        self._source, self._floor_at, self._support, self._config = source, floor_at, support, config
        self._lattice, self._traversed = lattice, traversed
        self._steps: dict[tuple[str, int], Evidence] = {}
        self._joins: dict[tuple[str, str], Evidence] = {}
        for evidence in remembered:
            if evidence.joins:
                self._joins[evidence.viewpoint, evidence.joins] = evidence
            else:
                self._steps[evidence.key] = evidence
        self._numbered: dict[tuple[str, str], tuple[Evidence, Evidence]] = {}
        self._others: dict[str, int | None] = {}
        self._stairs: dict[str, bool] = {}
        self._ends: dict[tuple[tuple[float, ...], tuple[float, float]], float] = {}
        self._views: dict[str, list[dict[int, FloorView]]] = {}
        self._ensemble = source if isinstance(source, MultiModelSource) else None
        self._slices: dict[int, SliceGaussians] = {}
        self.rendered_viewpoints = 0
        self.rendered_views = 0

    def around(self, viewpoint: Viewpoint, others: Iterable[Viewpoint] = ()) -> list[Evidence]:
        """Return the evidence of the eight lattice directions. The pixels of corridors to `others` are rendered with
        them, because these corridors may be measured next."""
        found = [self._steps.get((viewpoint.id, k)) for k in range(DIRECTIONS)]
        corridors = [self._step(viewpoint, k) for k in range(DIRECTIONS)]
        known = [
            e for e, c in zip(found, corridors, strict=True) if e is not None and self._is_complete(e, c, viewpoint)
        ]
        if len(known) == DIRECTIONS:
            return known
        wanted = {k: [corridor] for k, corridor in enumerate(corridors)}
        for other in others:
            if other.id != viewpoint.id:
                towards = _corridor(viewpoint, other.position[:2])
                wanted[view_of(towards, self._config)].append(towards)
        views = self._look_down(viewpoint, wanted)
        self._keep(viewpoint, views)
        self.rendered_viewpoints += 1
        measured = []
        for k, corridor in enumerate(corridors):
            evidence = self._measure([view[k] for view in views], viewpoint, k, corridor)
            self._steps[evidence.key] = evidence
            measured.append(evidence)
        return measured

    def corridor_evidence(self, viewpoint: Viewpoint, other: Viewpoint, also: Iterable[Viewpoint] = ()) -> Evidence:
        """Return the evidence of the corridor from one viewpoint to another. Its direction is -1; the caller numbers
        it. If a view must be rendered, the corridors to those of `also` that it shows are measured as well."""
        corridor = _corridor(viewpoint, other.position[:2])
        found = self._joins.get((viewpoint.id, other.id))
        if found is not None and self._is_complete(found, corridor, viewpoint):
            return found
        k = view_of(corridor, self._config)
        views = self._views.get(viewpoint.id)
        wanted = {other: corridor}
        if views is None or k not in views[0] or not views[0][k].shows_corridor(corridor, self._floor_at):
            for third in also:
                towards = _corridor(viewpoint, third.position[:2])
                shown = self._config.views == "panorama" or view_of(towards, self._config) == k
                if third.id not in (viewpoint.id, other.id) and shown:
                    wanted[third] = towards
            views = self._look_down(viewpoint, {k: list(wanted.values())})
            if self._config.views == "panorama" and self._needs_whole_views:
                self._keep(viewpoint, views)
        for end, towards in wanted.items():
            evidence = self._measure([view[k] for view in views], viewpoint, -1, towards, end.id)
            if not self._reaches(towards, end):
                evidence = replace(evidence, support=np.zeros_like(evidence.support))
            self._joins[viewpoint.id, end.id] = evidence
        return self._joins[viewpoint.id, other.id]

    def knows_floor(self, viewpoint: Viewpoint, other: Viewpoint) -> bool:
        """Whether the corridor would be open if it had no obstacles. This needs no rendering."""
        corridor = _corridor(viewpoint, other.position[:2])
        empty = evidence_without_obstacles(corridor, viewpoint.id, self._floor_at, self._support)
        return self._reaches(corridor, other) and decide(empty, self._config) == OPEN

    def _reaches(self, corridor: Corridor, other: Viewpoint) -> bool:
        """Whether a corridor to the position of a viewpoint ends at its floor, and not below or above it."""
        return abs(corridor.end(self._floor_at) - float(self._floor_at(np.array(other.position)))) <= _SAME_FLOOR

    def all_evidence(self) -> tuple[Evidence, ...]:
        """Return all evidence measured or remembered so far. Corridors to other viewpoints are numbered from 8."""
        for i, (ends, measured) in enumerate(self._joins.items(), DIRECTIONS):
            # Return identical objects in every call, because evidence caches its encoded bytes.
            if ends not in self._numbered or self._numbered[ends][0] is not measured:
                self._numbered[ends] = measured, replace(measured, direction=i)
        return (*self._steps.values(), *(numbered for _, numbered in self._numbered.values()))

    def _step(self, viewpoint: Viewpoint, k: int) -> Corridor:
        return _corridor(viewpoint, self._lattice.target(viewpoint.id, k))

    def arrival(self, viewpoint: Viewpoint, target: tuple[float, float]) -> tuple[float, float, float]:
        """Return world x, y, z in meters of the camera after it moved from a viewpoint to `target` (x, y), at an equal
        height above the floor."""
        ends = viewpoint.position, target
        if ends not in self._ends:
            self._ends[ends] = _corridor(viewpoint, target).end(self._floor_at)
        return *target, self._ends[ends] + viewpoint.height

    def _is_complete(self, evidence: Evidence, corridor: Corridor, viewpoint: Viewpoint) -> bool:
        heard = self._second_submap(viewpoint) is None or evidence.second is not None
        return heard and is_sufficient(evidence, corridor.length, corridor.heading, self._config)

    def _second_submap(self, viewpoint: Viewpoint) -> int | None:
        """The submap that gives a second opinion, in addition to the one that renders the viewpoint; None if there is
        none."""
        if self._ensemble is None or not self._config.second_opinion:
            return None
        if viewpoint.id not in self._others:
            self._others[viewpoint.id] = self._ensemble.second_submap(np.array(viewpoint.position))
        return self._others[viewpoint.id]

    def _look_down(self, viewpoint: Viewpoint, wanted: Mapping[int, Sequence[Corridor]]) -> list[dict[int, FloorView]]:
        """Render the views of each model that is used."""
        another = self._second_submap(viewpoint)
        place, models = np.array(viewpoint.position), [None] if another is None else [None, another]
        self.rendered_views += len(models) * (1 if self._config.views == "panorama" else len(wanted))
        return [
            render_pitched_views(self._source, place, wanted, self._floor_at, self._config, model) for model in models
        ]

    @property
    def _needs_whole_views(self) -> bool:
        """Whether whole views are rendered, because a network needs them."""
        return NETWORK_NORMAL in self._config.criteria

    def _keep(self, viewpoint: Viewpoint, views: list[dict[int, FloorView]]) -> None:
        """Cache the views of the last viewpoint. Whole views of several viewpoints are cached, because they show all
        corridors."""
        self._views.pop(viewpoint.id, None)
        pixels = sum({id(view): view.alpha.size for of_model in views for view in of_model.values()}.values())
        most = max(1, _KEPT // max(1, pixels)) if self._needs_whole_views else 1
        while len(self._views) >= most:
            del self._views[next(iter(self._views))]
        self._views[viewpoint.id] = views

    def _measure(
        self, views: Sequence[FloorView], viewpoint: Viewpoint, k: int, corridor: Corridor, joins: str = ""
    ) -> Evidence:
        """Measure a corridor with each model. The evidence of the first model holds that of the other as second
        opinion."""
        free = self._free(views[0], viewpoint, corridor)
        found = [measure(view, viewpoint.id, k, corridor, self._floor_at, self._support, joins, free) for view in views]
        if "slice" in self._config.criteria and self._ensemble is not None:
            found = [replace(e, mass=self._mass(self._ensemble, e.submap, viewpoint, corridor)) for e in found]
        if len(found) == 1:
            return found[0]
        return with_second_opinion(
            found[0], found[1], self._floor_of_other_submaps(found[1].submap, viewpoint, corridor)
        )

    def _free(self, view: FloorView, viewpoint: Viewpoint, corridor: Corridor) -> NDArray[np.bool_] | None:
        """(rows, cells) bool, floor that is free without a view; None if there is none. If known floor is required,
        this is floor over which the camera was carried. Near stairs, it is also floor that the corridor back shows
        better."""
        traversed = self._traversed if self._config.support > 0 else None
        ground = corridor.ground(self._floor_at)
        if not self._by_stair(viewpoint, corridor):
            found = None if traversed is None else traversed.is_surely_traversed(ground)
            return found if found is not None and found.any() else None
        free = out_of_sight(view.camera, ground) if self._config.both_ways else np.zeros(ground.shape[:2], bool)
        return free if traversed is None else free | traversed.is_traversed(ground)

    def _floor_of_other_submaps(self, submap: int, viewpoint: Viewpoint, corridor: Corridor) -> NDArray[np.bool_]:
        """(rows, cells) bool, floor whose nearest frame a submap was not trained on, so that it has no opinion
        there."""
        assert self._ensemble is not None
        ground = corridor.ground(self._floor_at)
        middle = ground[:, ground.shape[1] // 2] + [0.0, 0.0, viewpoint.height]
        known = self._ensemble.trained_at(submap, middle)
        return np.broadcast_to(~known[:, None], ground.shape[:2])

    def _by_stair(self, viewpoint: Viewpoint, corridor: Corridor) -> bool:
        """Whether a corridor climbs, or stairs are within one meter of its beginning."""
        if viewpoint.id not in self._stairs:
            x, y, z = viewpoint.position
            turns = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
            places = np.column_stack([x + np.sin(turns), y + np.cos(turns), np.full(DIRECTIONS, z)])
            off = np.asarray(self._floor_at(places)) - float(self._floor_at(np.array(viewpoint.position)))
            self._stairs[viewpoint.id] = bool((np.abs(off) > CLIMB).any())
        return self._stairs[viewpoint.id] or corridor.uses_stairs(self._floor_at)

    def _mass(
        self, ensemble: MultiModelSource, submap: int, viewpoint: Viewpoint, corridor: Corridor
    ) -> NDArray[np.uint8]:
        from nvsim.mapping.slice_mass import SliceGaussians

        if submap not in self._slices:
            self._slices[submap] = SliceGaussians(ensemble.gaussians(submap))
        return self._slices[submap].mass(corridor, self._floor_at, viewpoint.height)


def _corridor(viewpoint: Viewpoint, target: tuple[float, float]) -> Corridor:
    return Corridor(viewpoint.position[:2], target, viewpoint.position[2])
