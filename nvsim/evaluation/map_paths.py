"""Shortest paths of a robot on a true map, or on the maps of several storeys and the stairs between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.occupancy.geodesic import Geodesics
from nvsim.occupancy.paths import points_are_free, segments_are_free, standing_room
from nvsim.occupancy.storeys import Stair, StoreyMap, StoreyMaps
from nvsim.occupancy.types import OccupancyMap

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MapPaths:
    """Paths between places (N, 2), meters, whose floors are at heights (N,), world z.

    storeys   (N,) the map that each place is on
    """

    maps: StoreyMaps
    places: Float64
    storeys: NDArray[np.int64]
    _rooms: list[NDArray[np.bool_]]
    _geodesics: list[Geodesics]

    @classmethod
    def of(cls, occupancy: OccupancyMap | StoreyMaps, places: Float64, floors: Float64, radius: float) -> MapPaths:
        """Prepares paths between `places` (N, 2) with floors at heights `floors` (N,), for a robot of `radius`, all in
        meters."""
        one = isinstance(occupancy, OccupancyMap)
        maps = StoreyMaps((StoreyMap(0.0, occupancy),)) if isinstance(occupancy, OccupancyMap) else occupancy
        storeys = np.zeros(len(places), np.int64) if one else maps.nearest(floors)
        rooms = [standing_room(s.occupancy, radius) for s in maps.storeys]
        return cls(
            maps, places, storeys, rooms, [Geodesics(r, s.occupancy) for r, s in zip(rooms, maps.storeys, strict=True)]
        )

    @property
    def cells(self) -> int:
        """Number of traversable cells."""
        return sum(len(g) for g in self._geodesics)

    def stand(self) -> NDArray[np.bool_]:
        """(N,) bool, whether the robot can stand at each place."""
        found = np.zeros(len(self.places), bool)
        for k, storey in enumerate(self.maps.storeys):
            here = self.storeys == k
            found[here] = points_are_free(self._rooms[k], storey.occupancy, self.places[here])
        return found

    def straight(self, pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(P,) bool, whether the straight line between the places of each pair (P, 2) is free, on one storey."""
        a, b = pairs.T
        found = np.zeros(len(pairs), bool)
        for k, storey in enumerate(self.maps.storeys):
            here = (self.storeys[a] == k) & (self.storeys[b] == k)
            begin, end = self.places[a[here]], self.places[b[here]]
            found[here] = segments_are_free(self._rooms[k], storey.occupancy, begin, end)
        return found

    def lengths(self, sources: NDArray[np.int64], ends: NDArray[np.int64]) -> Float64:
        """(S, E) meters of the shortest paths from the places `sources` (S,) to `ends` (E,), infinite if there is none.
        Paths are on one storey or use stairs through their centers."""
        found = np.array([self._from(self.places[s], int(self.storeys[s]), ends) for s in sources])
        found = found.reshape(len(sources), len(ends))
        if not self.maps.stairs:
            return found
        stairs, between = self.maps.stairs, self._between_stairs()
        to_ends, to_sources = (np.array([self._to(stair, rows) for stair in stairs]) for rows in (ends, sources))
        over = (to_sources.T[:, :, None] + between).min(axis=1)  # from each source to each stair
        return np.asarray(np.minimum(found, (over[:, :, None] + to_ends[None]).min(axis=1)))

    def _from(self, place: Float64, storey: int, ends: NDArray[np.int64]) -> Float64:
        """(E,) meters from a place (2,) of a storey to those of `ends` on the same storey, infinite to the others."""
        found = np.full(len(ends), np.inf)
        here = self.storeys[ends] == storey
        metres = self._geodesics[storey].lengths(place, self.places[ends[here]])
        found[here] = np.where(np.isnan(metres), np.inf, metres)
        return found

    def _to(self, stair: Stair, rows: NDArray[np.int64]) -> Float64:
        """(R,) meters from the center of a stair to places on the storeys that it connects."""
        middle = np.mean(stair.outline, axis=0)
        sides = [self._from(middle, k, rows) for k in (stair.lower, stair.upper)]
        return np.minimum(*sides) + self._climb(stair) / 2

    def _climb(self, stair: Stair) -> float:
        """Meters by which a stair is longer than its horizontal projection."""
        corners = np.array(stair.outline)
        run = float(np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).max())
        rise = self.maps.storeys[stair.upper].floor - self.maps.storeys[stair.lower].floor
        return float(np.hypot(run, rise) - run)

    def _between_stairs(self) -> Float64:
        """(T, T) meters of the shortest paths between the centers of stairs, including paths over other stairs."""
        stairs = self.maps.stairs
        middles = [np.mean(s.outline, axis=0) for s in stairs]
        apart = np.where(np.eye(len(stairs), dtype=bool), 0.0, np.inf)
        for i, one in enumerate(stairs):
            for j, other in enumerate(stairs[:i]):
                for k in {one.lower, one.upper} & {other.lower, other.upper}:
                    metres = self._geodesics[k].lengths(middles[i], middles[j][None])[0]
                    if np.isfinite(metres):
                        climbs = (self._climb(one) + self._climb(other)) / 2
                        apart[i, j] = apart[j, i] = min(apart[i, j], metres + climbs)
        for via in range(len(stairs)):
            apart = np.minimum(apart, apart[:, via, None] + apart[via])
        return apart
