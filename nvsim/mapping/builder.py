"""Build the navigation graph from trained models and a trajectory: run searches, choose their starts, and report the
result."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.events import Listener, Log, Progress, Warning, ignore_event
from nvsim.graph.paths import components
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import HeightAt, Lattice, SupportAt
from nvsim.mapping.evidence.measuring import Measurements
from nvsim.mapping.evidence.traversed_floor import TraversedFloor
from nvsim.mapping.explanation.poor_graph import (
    NoViewpointFound,
    explain_disconnected_parts,
    explain_no_viewpoint,
    explain_small_graph,
)
from nvsim.mapping.explanation.seen_floor import SeenFloor
from nvsim.mapping.explanation.trajectory_detour import TrajectoryDetour
from nvsim.mapping.explanation.wall_openings import PossibleGlass, WallOpenings
from nvsim.mapping.search.breadth_first import BreadthFirstSearch
from nvsim.mapping.search.graph_builder import GraphBuilder, keep_edits
from nvsim.mapping.search.survey import Survey
from nvsim.mapping.search.trajectory import CoveredPositions, Walk
from nvsim.mapping.settling.settling import Settling
from nvsim.mapping.views.view_sources import ViewSource
from nvsim.plain_text import count_text

STAGE = "map"
_TRIES = 3  # positions on either side of a gap in the trajectory that are tried as a start
_FEW = 3  # with fewer viewpoints, the floor beside the trajectory is tried as well
_A_DOZEN = 12  # with fewer viewpoints, the trajectory is covered more closely
_BESIDE = 0.5  # meters between the positions that are tried beside the trajectory
_SHORT, _CLOSER = 1.5, 0.4  # without a LiDAR scan, a trajectory shorter than 1.5 merge radii uses 0.4 of the radius
_HOPS = 4  # maximum edges between the viewpoints of consecutive positions; with more, the graph has a gap
_KEEPING = 5.0  # minimum seconds between two saves of the evidence
_RARELY = 20  # minimum pause between saves, as a multiple of the duration of a save
_CROWD = 0.5  # meters; minimum distance of a start in a gap from existing viewpoints


@dataclass(frozen=True, eq=False)
class BuildResult:
    """The result of a build.

    graph     the navigation graph
    report    JSON values: viewpoints, edges, components, component_sizes, starts, rendered_viewpoints, rendered_views,
              seconds in total and search_seconds before settling, viewpoints_per_s, decisions (word -> count),
              walk_uncovered (positions without a viewpoint), led_around (removed edges), isolated_removed, limited
    measured  all evidence, as a graph without viewpoints; includes evidence of viewpoints that `graph` does not have
    """

    graph: NavGraph
    report: dict[str, Any]
    measured: NavGraph


def build_map(
    source: ViewSource,
    trajectory: NDArray[np.floating],
    floor_at: HeightAt,
    support: SupportAt,
    config: MappingConfig,
    *,
    scan: str,
    start: NDArray[np.floating] | None = None,
    previous: NavGraph | None = None,
    remembered: NavGraph | None = None,
    scanned: bool = True,
    openings: WallOpenings | None = None,
    seen: SeenFloor | None = None,
    listen: Listener = ignore_event,
    keep: Callable[[NavGraph], None] | None = None,
) -> BuildResult:
    """Build the navigation graph of the camera positions `trajectory` (N, 3), meters, world. The search begins at
    `start` (3,) if it is given.

    `floor_at` gives floor heights and `support` whether floor is known, both at world points. Evidence of `previous`,
    and of an earlier build (`remembered`), is decided again and not rendered. A user's edits of `previous` are kept.
    Every few seconds, `keep` receives all evidence measured so far, as a graph. An interrupted build that gets it as
    `remembered` ends like a complete build.

    `scanned` tells whether there is a LiDAR scan. Without one, floor over which the camera was carried is free. Edges
    through which a glass pane may be are then removed (`config.around`); `PossibleGlass` explains `openings` and
    `seen`.

    Raises InputError if the trajectory is empty or not finite, or if no position on it has room for a viewpoint.
    Source: paper, section III-D, Algorithm 1.
    """
    if len(trajectory) == 0 or not np.isfinite(trajectory).all():
        raise InputError(
            "The trajectory is empty or has a position that is not finite; check the capture with `nvsim check`."
        )
    started = time.monotonic()
    in_one_room = not scanned and float(np.ptp(trajectory[:, :2], axis=0).max()) < _SHORT * config.merge_radius
    if in_one_room:  # the whole floor fits into one merge radius
        config = replace(config, merge_radius=_CLOSER * config.merge_radius)
    known = [e for graph in (remembered, previous) if graph is not None for e in graph.evidence.values()]
    lattice = Lattice(config)
    measurements = Measurements(source, floor_at, support, config, lattice, known, TraversedFloor(trajectory, scanned))
    walk = Walk(trajectory, support)
    survey = Survey(GraphBuilder(scan, walk.storey), lattice, measurements, walk, floor_at, config)
    search = BreadthFirstSearch(survey)

    def with_measurements() -> NavGraph:
        return NavGraph(scan, evidence={e.key: e for e in measurements.all_evidence()})

    def keep_evidence() -> None:
        if keep is not None:
            keep(with_measurements())

    explorer = _Explorer(search, walk, config, listen, keep_evidence)
    if start is not None or config.starts == "one":
        explorer.begin(walk.places[0] if start is None else start)
    if config.starts == "cover":
        explorer.cover()
        explorer.bridge()
        explorer.start_beside_trajectory()
        if not scanned:
            explorer.cover_closely()
        if in_one_room:
            explorer.begin_beside()
    draft, searched = search.draft, time.monotonic()
    if config.settle:
        Settling(survey, explorer.settling).run()
    behind_glass = 0
    if config.around and not scanned:
        glass = PossibleGlass(TrajectoryDetour(walk, config.around), openings, seen)
        behind_glass = _remove_possible_glass(draft, glass, survey)
    if not draft.viewpoints:
        raise NoViewpointFound(explain_no_viewpoint(search.refusals, config))
    uncovered = [p for p in walk.places if not explorer.is_covered(p)]
    alone = [id for id in draft.viewpoints if not draft.joined(id)] if len(draft.viewpoints) > 1 else []
    isolated = [] if config.isolated else alone
    for id in isolated:
        draft.remove(id)
    graph = keep_edits(draft.graph(), previous)
    explorer.finish()
    seconds = time.monotonic() - started
    words: dict[str, int] = {}
    for evidence in graph.evidence.values():
        words[evidence.decision] = words.get(evidence.decision, 0) + 1
    groups = components(graph)
    disconnection = explain_disconnected_parts(groups, survey, support)
    report = {
        "viewpoints": len(graph.viewpoints),
        "edges": len(graph.edges),
        "components": len(groups),
        "component_sizes": [len(g) for g in groups[:20]],
        "starts": sum(v.origin == "start" for v in graph.viewpoints.values()),
        "rendered_viewpoints": measurements.rendered_viewpoints,
        "rendered_views": measurements.rendered_views,
        "seconds": round(seconds, 3),
        "search_seconds": round(searched - started, 3),
        "viewpoints_per_s": round(measurements.rendered_viewpoints / max(seconds, 1e-9), 3),
        "decisions": dict(sorted(words.items())),
        "walk_uncovered": len(uncovered),
        "led_around": behind_glass,
        "isolated_removed": len(isolated),
        "limited": search.limited,
    }
    _report_build(report, len(walk.places), disconnection, config, listen)
    sentence = explain_small_graph(report, np.array(uncovered), len(walk.places))
    if sentence:
        listen(Warning(sentence, STAGE))
    return BuildResult(graph, report, with_measurements())


def _remove_possible_glass(draft: GraphBuilder, glass: PossibleGlass, survey: Survey) -> int:
    """Remove edges through which a glass pane may be, and return their number. This step is the last, so that no
    viewpoint and no other edge depends on it."""
    found = 0
    for a, b in list(draft.edges()):
        ends = draft.viewpoints[a], draft.viewpoints[b]
        if glass.reason(ends[0].position, ends[1].position):
            draft.remove_edge(a, b)
            found += 1
            for here, there in (ends, ends[::-1]):
                survey.record_omitted_edge(here, there, "around")
    return found


def _report_build(
    report: dict[str, Any], places: int, disconnection: str, config: MappingConfig, listen: Listener
) -> None:
    """Report a build to the user. `disconnection` explains why parts of the graph are disconnected."""
    if report["limited"]:
        listen(
            Warning(
                f"The search stopped at {config.max_viewpoints} viewpoints; raise max_viewpoints to find the rest.",
                STAGE,
            )
        )
    if report["decisions"].get("distance"):
        count = report["decisions"]["distance"]
        steps = count_text(count, "free step")
        listen(Log(f"{steps} would have led farther than {config.max_distance} m from the trajectory.", STAGE))
    if report["decisions"].get("disputed"):
        count = report["decisions"]["disputed"]
        listen(Log(f"{count} corridors have no edge because two submap models disagree about them.", STAGE))
    if report["led_around"]:
        text = (
            f"Removed edges: {report['led_around']}. The trajectory goes around them through a door or on a long "
            "detour, and without a LiDAR scan, glass panes cannot be excluded (--around 0 keeps them)."
        )
        listen(Log(text, STAGE))
    if report["components"] > 1:
        sizes = ", ".join(map(str, report["component_sizes"]))
        text = f"The graph has {report['components']} disconnected parts ({sizes} viewpoints)."
        listen(Warning(f"{text} {disconnection}".rstrip(), STAGE))
    if report["walk_uncovered"]:
        text = f"{report['walk_uncovered']} of {places} positions of the trajectory have no viewpoint nearby."
        listen(Log(text, STAGE))


class _Explorer:
    """Starts searches until the trajectory is covered and the graph follows it."""

    def __init__(
        self,
        search: BreadthFirstSearch,
        walk: Walk,
        config: MappingConfig,
        listen: Listener,
        keep: Callable[[], None],
    ) -> None:
        self._search, self._walk, self._config = search, walk, config
        self._listen = listen
        self._tried: set[int] = set()
        self._reach = config.cover_distance
        self._covered = CoveredPositions(walk.places, search.draft, config.cover_distance, self.is_covered)
        self._said = ""
        self._keep, self._kept, self._pause = keep, time.monotonic(), _KEEPING

    def begin(self, place: NDArray[np.floating]) -> None:
        """Start at one position (3,), on the trajectory or beside it."""
        if self._search.start(place):
            self._search.run(self.progress)
            self.progress()

    def cover(self) -> None:
        """Start at the position with the most clearance, then at those that are not covered yet, in the order of
        clearance."""
        # Stable sort: of equal clearances, the earliest position comes first. The order is fixed, so one pass visits
        # every position.
        for place in np.argsort(-np.round(self._walk.clearance, 6), kind="stable"):
            if not self.is_covered(self._walk.places[place]):
                self._start(int(place))

    def bridge(self) -> None:
        """Start searches in gaps, where the graph does not follow the trajectory."""
        progress = True
        while progress:
            progress = False
            for i in self._gaps():
                for k in [i + d for n in range(_TRIES) for d in (-n, n + 1)]:
                    free = 0 <= k < len(self._walk.places) and k not in self._tried
                    if free and not self._search.draft.viewpoints_near(self._walk.places[k], _CROWD):
                        progress = self._start(k) or progress
                        break
                if progress:
                    break

    def start_beside_trajectory(self) -> None:
        """If the trajectory gave very few viewpoints, start on the known floor beside it."""
        if len(self._search.draft.viewpoints) < _FEW:
            self.begin_beside()

    def begin_beside(self) -> None:
        """Start on the known floor beside the trajectory."""
        for place in self._walk.positions_beside(self._config.half_width, _BESIDE):
            self.begin(place)

    def cover_closely(self) -> None:
        """If there are few viewpoints, start at every position without a viewpoint within the merge radius. The
        viewpoints of one or two rooms are seldom too many."""
        if len(self._search.draft.viewpoints) < _A_DOZEN and self._config.merge_radius < self._reach:
            usual, self._reach = self._reach, self._config.merge_radius
            self.cover()
            self.bridge()
            self._reach = usual

    def is_covered(self, place: NDArray[np.floating]) -> bool:
        return self._covering_viewpoint(place) is not None

    def _covering_viewpoint(self, place: NDArray[np.floating]) -> str | None:
        """Return the nearest viewpoint in line with a position of the trajectory."""
        for viewpoint in self._search.draft.viewpoints_near(place, self._reach):
            if self._walk.is_line_known(np.array(viewpoint.position), place):
                return viewpoint.id
        return None

    def _gaps(self) -> list[int]:
        """Return the positions i of the trajectory before a gap: the viewpoint of the next position is many edges away,
        or in another component, although the camera was carried straight there."""
        gaps: list[int] = []
        last: str | None = None
        for i, place in enumerate(self._walk.places):
            if i and not self._walk.joined[i - 1]:
                last = None
            coverer = self._covering_viewpoint(place)
            if coverer is None:
                continue
            if last is not None and not self._search.draft.is_within(last, coverer, _HOPS):
                gaps.append(i - 1)
            last = coverer
        return gaps

    def _start(self, place: int) -> bool:
        self._tried.add(place)
        if not self._search.start(self._walk.places[place]):
            self._covered.give_up(place)
            return False
        self._search.run(self.progress)
        self.progress()
        return True

    def progress(self) -> None:
        """Report how many positions of the trajectory are left, or how many viewpoints wait."""
        self._covered.update(self._search.expanded)
        left, waiting = self._covered.count_left, self._search.waiting
        if left:
            self._report_progress(f"{left} position{'s' if left > 1 else ''} of the trajectory left")
        else:
            self._report_progress(f"{waiting} of them to expand" if waiting else "joining them")
        self._keep_now_and_then()

    def settling(self) -> None:
        self._report_progress("settling the graph")
        self._keep_now_and_then()

    def finish(self) -> None:
        self._report_progress("")

    def _report_progress(self, then: str) -> None:
        """Report progress in positions of the trajectory. It is complete only at the end, without `then`."""
        found, places = len(self._search.draft.viewpoints), len(self._walk.places)
        words = f"{found} viewpoint{'' if found == 1 else 's'}" + (f", {then}" if then else "")
        if words != self._said:
            self._said = words
            self._listen(Progress(STAGE, min(places - self._covered.count_left, places - bool(then)), places, words))

    def _keep_now_and_then(self) -> None:
        now = time.monotonic()
        if now - self._kept > self._pause:
            self._keep()
            self._kept = time.monotonic()
            # Every save holds more evidence.
            self._pause = max(_KEEPING, _RARELY * (self._kept - now))
