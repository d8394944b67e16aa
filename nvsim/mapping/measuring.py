"""Evidence on demand: remembered where it was measured before, rendered where it was not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence, Viewpoint
from nvsim.mapping.climbing import CLIMB, Trodden, out_of_sight
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS, Corridor, HeightAt, SupportAt, nothing_stands, view_of
from nvsim.mapping.criteria import OPEN, answers, decide
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.mapping.floor_view import FloorView, measure
from nvsim.mapping.lattice import Lattice
from nvsim.mapping.looking import look_down
from nvsim.mapping.opinions import joined
from nvsim.mapping.view_source import Ensemble, ViewSource

if TYPE_CHECKING:
    from nvsim.mapping.slice_mass import Slice

_SAME_FLOOR = 0.5  # metres
_KEPT = 1 << 22  # pixels of the views of recent viewpoints that are kept where a network looks at whole views


class Measurements:
    """rendered_viewpoints  viewpoints that a whole turn was rendered at
    rendered_views       single views or panoramas, those of the turns and of second opinions included
    """

    def __init__(
        self,
        source: ViewSource,
        floor_at: HeightAt,
        support: SupportAt,
        config: MappingConfig,
        lattice: Lattice,
        remembered: Iterable[Evidence] = (),
        trodden: Trodden | None = None,
    ) -> None:
        """`trodden` says where somebody carried the camera: beside a stair, which few views show, that counts, and
        everywhere where images alone tell what stands."""
        self._source, self._floor_at, self._support, self._config = source, floor_at, support, config
        self._lattice, self._trodden = lattice, trodden
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
        self._ensemble = source if isinstance(source, Ensemble) else None
        self._slices: dict[int, Slice] = {}
        self.rendered_viewpoints = 0
        self.rendered_views = 0

    def around(self, viewpoint: Viewpoint, others: Iterable[Viewpoint] = ()) -> list[Evidence]:
        """The evidence of the eight lattice directions. Corridors to `others` may be asked for next: what they are read
        from is rendered along."""
        found = [self._steps.get((viewpoint.id, k)) for k in range(DIRECTIONS)]
        corridors = [self._step(viewpoint, k) for k in range(DIRECTIONS)]
        known = [e for e, c in zip(found, corridors, strict=True) if e is not None and self._holds(e, c, viewpoint)]
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

    def between(self, viewpoint: Viewpoint, other: Viewpoint, also: Iterable[Viewpoint] = ()) -> Evidence:
        """The evidence of the corridor from one viewpoint to another; its direction is -1, for the caller to number.
        Where a view has to be rendered for it, the corridors to those of `also` that it shows are measured as well."""
        corridor = _corridor(viewpoint, other.position[:2])
        found = self._joins.get((viewpoint.id, other.id))
        if found is not None and self._holds(found, corridor, viewpoint):
            return found
        k = view_of(corridor, self._config)
        views = self._views.get(viewpoint.id)
        wanted = {other: corridor}
        if views is None or k not in views[0] or not views[0][k].shows(corridor, self._floor_at):
            for third in also:
                towards = _corridor(viewpoint, third.position[:2])
                shown = self._config.views == "panorama" or view_of(towards, self._config) == k
                if third.id not in (viewpoint.id, other.id) and shown:
                    wanted[third] = towards
            views = self._look_down(viewpoint, {k: list(wanted.values())})
            if self._config.views == "panorama" and self._whole:
                self._keep(viewpoint, views)
        for end, towards in wanted.items():
            evidence = self._measure([view[k] for view in views], viewpoint, -1, towards, end.id)
            if not self._reaches(towards, end):
                evidence = replace(evidence, support=np.zeros_like(evidence.support))
            self._joins[viewpoint.id, end.id] = evidence
        return self._joins[viewpoint.id, other.id]

    def knows_floor(self, viewpoint: Viewpoint, other: Viewpoint) -> bool:
        """Whether the corridor would pass if nothing stood in it, which needs no rendering."""
        corridor = _corridor(viewpoint, other.position[:2])
        empty = nothing_stands(corridor, viewpoint.id, self._floor_at, self._support)
        return self._reaches(corridor, other) and decide(empty, self._config) == OPEN

    def _reaches(self, corridor: Corridor, other: Viewpoint) -> bool:
        """Whether a corridor to the place of a viewpoint ends at its floor, and not beneath or over it."""
        return abs(corridor.end(self._floor_at) - float(self._floor_at(np.array(other.position)))) <= _SAME_FLOOR

    def everything(self) -> tuple[Evidence, ...]:
        """All evidence measured or remembered so far; corridors to other viewpoints are numbered from 8."""
        for i, (ends, measured) in enumerate(self._joins.items(), DIRECTIONS):
            # The same objects every time: one that was written remembers its bytes.
            if ends not in self._numbered or self._numbered[ends][0] is not measured:
                self._numbered[ends] = measured, replace(measured, direction=i)
        return (*self._steps.values(), *(numbered for _, numbered in self._numbered.values()))

    def _step(self, viewpoint: Viewpoint, k: int) -> Corridor:
        return _corridor(viewpoint, self._lattice.target(viewpoint.id, k))

    def arrival(self, viewpoint: Viewpoint, target: tuple[float, float]) -> tuple[float, float, float]:
        """World x, y, z of the camera that has gone from a viewpoint to `target` (x, y), as high above the floor."""
        ends = viewpoint.position, target
        if ends not in self._ends:
            self._ends[ends] = _corridor(viewpoint, target).end(self._floor_at)
        return *target, self._ends[ends] + viewpoint.height

    def _holds(self, evidence: Evidence, corridor: Corridor, viewpoint: Viewpoint) -> bool:
        heard = self._another(viewpoint) is None or evidence.second is not None
        return heard and answers(evidence, corridor.length, corridor.heading, self._config)

    def _another(self, viewpoint: Viewpoint) -> int | None:
        """The submap whose opinion is asked beside that of the one that renders the viewpoint."""
        if self._ensemble is None or not self._config.second_opinion:
            return None
        if viewpoint.id not in self._others:
            self._others[viewpoint.id] = self._ensemble.another(np.array(viewpoint.position))
        return self._others[viewpoint.id]

    def _look_down(self, viewpoint: Viewpoint, wanted: Mapping[int, Sequence[Corridor]]) -> list[dict[int, FloorView]]:
        """The views of each model that is asked."""
        another = self._another(viewpoint)
        place, models = np.array(viewpoint.position), [None] if another is None else [None, another]
        self.rendered_views += len(models) * (1 if self._config.views == "panorama" else len(wanted))
        return [look_down(self._source, place, wanted, self._floor_at, self._config, model) for model in models]

    @property
    def _whole(self) -> bool:
        """Whether views are rendered whole, as a network needs them."""
        return NETWORK_NORMAL in self._config.criteria

    def _keep(self, viewpoint: Viewpoint, views: list[dict[int, FloorView]]) -> None:
        """Remembers the views of the last viewpoint; whole ones of several, as they show all of its corridors."""
        self._views.pop(viewpoint.id, None)
        pixels = sum({id(view): view.alpha.size for of_model in views for view in of_model.values()}.values())
        most = max(1, _KEPT // max(1, pixels)) if self._whole else 1
        while len(self._views) >= most:
            del self._views[next(iter(self._views))]
        self._views[viewpoint.id] = views

    def _measure(
        self, views: Sequence[FloorView], viewpoint: Viewpoint, k: int, corridor: Corridor, joins: str = ""
    ) -> Evidence:
        """What each model shows of a corridor, the first with the other's opinion."""
        free = self._free(views[0], viewpoint, corridor)
        found = [measure(view, viewpoint.id, k, corridor, self._floor_at, self._support, joins, free) for view in views]
        if "slice" in self._config.criteria and self._ensemble is not None:
            found = [replace(e, mass=self._mass(self._ensemble, e.submap, viewpoint, corridor)) for e in found]
        if len(found) == 1:
            return found[0]
        return joined(found[0], found[1], self._strange(found[1].submap, viewpoint, corridor))

    def _free(self, view: FloorView, viewpoint: Viewpoint, corridor: Corridor) -> NDArray[np.bool_] | None:
        """(rows, cells) the floor that needs no view: that which somebody walked over, where known floor is asked for,
        and by a stair that which the corridor back shows better. None where there is none."""
        trodden = self._trodden if self._config.support > 0 else None
        ground = corridor.ground(self._floor_at)
        if not self._by_stair(viewpoint, corridor):
            found = None if trodden is None else trodden.surely_at(ground)
            return found if found is not None and found.any() else None
        free = out_of_sight(view.camera, ground) if self._config.both_ways else np.zeros(ground.shape[:2], bool)
        return free if trodden is None else free | trodden.at(ground)

    def _strange(self, submap: int, viewpoint: Viewpoint, corridor: Corridor) -> NDArray[np.bool_]:
        """(rows, cells) the floor whose nearest frame a submap was not trained on, so that its opinion is none."""
        assert self._ensemble is not None
        ground = corridor.ground(self._floor_at)
        middle = ground[:, ground.shape[1] // 2] + [0.0, 0.0, viewpoint.height]
        known = self._ensemble.trained_at(submap, middle)
        return np.broadcast_to(~known[:, None], ground.shape[:2])

    def _by_stair(self, viewpoint: Viewpoint, corridor: Corridor) -> bool:
        """Whether a corridor climbs, or a stair is within a metre of where it begins."""
        if viewpoint.id not in self._stairs:
            x, y, z = viewpoint.position
            turns = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
            places = np.column_stack([x + np.sin(turns), y + np.cos(turns), np.full(DIRECTIONS, z)])
            off = np.asarray(self._floor_at(places)) - float(self._floor_at(np.array(viewpoint.position)))
            self._stairs[viewpoint.id] = bool((np.abs(off) > CLIMB).any())
        return self._stairs[viewpoint.id] or corridor.climbs(self._floor_at)

    def _mass(self, ensemble: Ensemble, submap: int, viewpoint: Viewpoint, corridor: Corridor) -> NDArray[np.uint8]:
        from nvsim.mapping.slice_mass import Slice

        if submap not in self._slices:
            self._slices[submap] = Slice(ensemble.gaussians(submap))
        return self._slices[submap].mass(corridor, self._floor_at, viewpoint.height)


def _corridor(viewpoint: Viewpoint, target: tuple[float, float]) -> Corridor:
    return Corridor(viewpoint.position[:2], target, viewpoint.position[2])
