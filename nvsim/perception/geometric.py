"""The geometric provider: floor masks without any network. The floor surface is laid into the image, what the cloud
shows before it hides it, floor that nothing confirms is left out, and the edge is moved to the image's own edge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.splatting import SplatCloud
from nvsim.geometry.spread import spread
from nvsim.perception.appearance import AppearanceConfig, FloorAppearance, Glimpse
from nvsim.perception.glass import GlassConfig, SeeThrough
from nvsim.perception.growing import grow
from nvsim.perception.hybrid import large_regions
from nvsim.perception.obstacles import standing
from nvsim.perception.refine import RefineConfig, refine
from nvsim.perception.roles import Float32, FloorMask, Image, Mask
from nvsim.perception.stairs import Stairs

_HIGH = 0.25  # metres above the floor from which on nobody takes a thing for floor
_ALIKE = 0.5  # likeness from which on a pixel may be floor
_SPECK = 0.02  # metres: half-width of a point that hides next to nothing


@dataclass(frozen=True)
class GeometricConfig:
    """clearance     metres: what is higher above the floor is not floor
    farthest      metres: floor further away is left out, a pixel of it says nothing
    longest_side  pixels of the image in which occlusion is decided
    cover         half-width of a cloud point's square, in distances to its fourth neighbour
    sparse        a surface whose points are this many times as far apart as usual is noise or glass: hides little
    shrink        share of that half-width taken back from silhouettes: squares overhang what they stand for
    contact       a point nearer than this share of the way to the floor behind it is a silhouette, not a foot
    margin        share of the way to the floor from which on a point no longer hides it
    speck         regions and holes smaller than this share of the image are noise of the cloud
    level         a pixel whose own depth differs by less than this share from that of the floor shows floor,
    before        and one that is nearer by more than this share something before it
    glimpses      views from which the floor's looks are learnt, at most
    filled        probability by a network from which on what nothing hides and nothing confirms is floor,
    edge          pixels beside floor that things are drawn too large by: there,
    filled_edge   beside a scan, what is hidden is floor from this probability on,
    never         and below this one nothing is but stairs: people, whom no scan has, and the foot of panes;
    never_edge    and, of floor within `rim` pixels of something else, below this one
    usual         and from which on floor stays that looks otherwise than elsewhere: gloss, a lamp's light
    filled_thin   as `filled`, where the cloud is of images: bare floor has few points there;
    usual_thin    and as `usual`: dark cupboards have few, too;
    filled_behind  there also what something hides: thin things are drawn too thick, a table where its floor is seen,
    doubted       and below which what nothing hides is none: near walls have holes there,
    never_thin    or, where the image's own depth is that of the floor, below this one: bare walls are taken for it
    wall          upward component of the normals that a network sees, below which it sees a wall or a front: where the
                  image has no depth of its own, that is no floor which nothing confirms,
    filled_wall   nor other floor below this probability
    """

    clearance: float = 0.05
    farthest: float = 20.0
    longest_side: int = 320
    cover: float = 0.8
    sparse: float = 2.0
    shrink: float = 0.75
    contact: float = 0.95
    margin: float = 0.998
    speck: float = 0.0006
    level: float = 0.02
    before: float = 0.05
    glimpses: int = 160
    filled: float = 0.9
    edge: float = 1.2
    filled_edge: float = 0.5
    never: float = 0.0002
    never_edge: float = 0.002
    rim: float = 2.5
    usual: float = 0.5
    filled_thin: float = 0.5
    usual_thin: float = 0.85
    filled_behind: float = 0.8
    doubted: float = 0.05
    never_thin: float = 0.0005
    wall: float = 0.2
    filled_wall: float = 0.5
    appearance: AppearanceConfig = AppearanceConfig()
    refine: RefineConfig = RefineConfig()
    glass: GlassConfig = GlassConfig()


@dataclass(frozen=True, eq=False)
class Projection:
    """What geometry alone says about a view, at the working size.

    floor     (h, w) bool
    hidden    (h, w) bool, floor that has something before it
    unsure    (h, w) bool, floor that nothing hides and nothing confirms
    scale     (h, w) float32, pixels of the full image that a metre takes
    ground    (h, w, 2) float32, metres, where the rays meet the floor surface
    distance  (h, w) float32, metres along the rays to there, 0 where they do not meet it
    before    (h, w) float32, metres along the rays to what stands nearest, inf where nothing does
    """

    floor: Mask
    hidden: Mask
    unsure: Mask
    scale: Float32
    ground: Float32
    distance: Float32
    before: Float32


class _OwnDepth(NamedTuple):
    """What the depth of an image says of each pixel, (h, w) bool: where it is the floor's, where it shows something
    before the floor, and where it is known."""

    level: Mask
    before: Mask
    known: Mask


class GeometricFloor:
    """A FloorSegmenter, from a cloud (or None) and the floor surface that holds where the cameras are."""

    def __init__(self, cloud: Cloud | None, surface: FloorSurface, config: GeometricConfig | None = None) -> None:
        self.config = config or GeometricConfig()
        self.surface, self._stairs = surface, Stairs.of(surface)
        self._appearance: FloorAppearance | None = None
        self._is_sparse = cloud is not None and not cloud.is_dense
        self._standing = standing(cloud, surface, self.config.clearance, self.config.cover, self.config.sparse)
        self._splats = SplatCloud.of(self._standing.points, self._standing.radii)

    def learn(
        self,
        cameras: Sequence[Camera],
        read: Callable[[int], Image],
        threads: int = 1,
        usable_of: Callable[[int], Mask | None] = lambda index: None,
    ) -> None:
        """Learns what the floor looks like from views spread over the trajectory; `read` gives the image (H, W, 3)
        uint8 RGB of the camera at an index, and `usable_of` the pixels of it that count, None for all, at any size, in
        `threads` at once. Without it, what the cloud misses stays in the masks."""
        chosen = spread(len(cameras), self.config.glimpses)

        def look(index: int) -> tuple[Projection, Glimpse]:
            projection = _counted(self.project(cameras[index]), usable_of(index))
            return projection, self._glimpse(projection, read(index))

        with ThreadPoolExecutor(threads) as pool:
            looks = list(pool.map(look, chosen))
        seen, glimpses = [projection for projection, _ in looks], [glimpse for _, glimpse in looks]
        self._appearance = FloorAppearance.learn(glimpses, self.config.appearance)
        if self._appearance is None:
            return
        through = SeeThrough(self.config.glass)
        for i, projection, view in zip(chosen, seen, glimpses, strict=True):
            expected, known = self._appearance.expected(view)
            hits = cameras[i].position + projection.before[..., None] * self._small(cameras[i]).rays()
            hidden = projection.hidden & known & np.isfinite(projection.before)
            behind = projection.distance - projection.before
            through.vote(self._appearance.logs(view), expected, hidden, hits.astype(np.float32), behind)
        glass = through.glass(self._standing.points)
        radii = np.where(glass, np.minimum(self._standing.radii, _SPECK), self._standing.radii).astype(np.float32)
        self._splats = self._splats.with_radii(radii)

    def segment(
        self, camera: Camera, image: Image, depth: Float32 | None = None, looks: Float32 | None = None,
        upward: Float32 | None = None,
    ) -> FloorMask:  # fmt: skip
        """The floor of an undistorted image (H, W, 3) uint8 RGB seen by `camera`; where the image's own `depth` along
        the optical axis is known, (h, w) of any size, metres, 0 elsewhere, it comes before what the cloud shows, and
        what looks like the floor there, though nothing confirms it, is doubtful. Where a network says how much the
        image `looks` like floor, (H, W), 0 to 1, it fills what nothing hides and nothing confirms, and decides at the
        edges of what stands before floor. Where another says how far surfaces face `upward`, (H, W), the world's z of
        their normals, fronts of which the image knows no depth are no floor."""
        import cv2

        seen = self.project(camera)
        floor, own = seen.floor, _OwnDepth(*np.zeros((3, *seen.floor.shape), bool))
        if depth is not None:
            floor, own = self._with_depth(seen, camera, depth)
        view = self._glimpse(seen, image)
        small: Float32 | None = None
        if looks is not None and self.knows_floor:
            shown = cv2.resize(looks, (floor.shape[1], floor.shape[0]), interpolation=cv2.INTER_AREA)
            small = np.asarray(shown, np.float32)
        if self._is_sparse:
            floor = grow(floor, seen.floor | seen.unsure, view.image)
        elif self._appearance is not None:
            usual = ~self._appearance.strange(view)
            if small is not None:
                usual |= small > (self.config.usual if depth is None else self.config.usual_thin)
            floor = floor & (own.level | self._stairs.at(seen.ground) | usual)
            floor |= self._appearance.shining_through(view, seen.hidden)
        if small is not None:
            if depth is None:
                rim = cv2.distanceTransform(floor.astype(np.uint8), cv2.DIST_L2, 3) < self.config.rim
                least = np.where(rim, self.config.never_edge, self.config.never)
                floor &= (small > least) | self._stairs.at(seen.ground)
                floor |= seen.unsure & (small > self.config.filled)
                beside = cv2.distanceTransform((~floor).astype(np.uint8), cv2.DIST_L2, 3) < self.config.edge
                floor |= seen.hidden & beside & (small > self.config.filled_edge)
            else:
                floor = self._as_it_looks(floor, seen, own, small, upward)
        mask = refine(floor, seen.scale, image, self.config.refine)
        if depth is None or self._appearance is None:
            return FloorMask(mask, mask)
        alike = self._appearance.likeness(view) > _ALIKE
        doubtful = ((seen.floor | seen.unsure) & ~own.before & alike).astype(np.uint8)
        sized = cv2.resize(doubtful, (mask.shape[1], mask.shape[0]), interpolation=cv2.INTER_NEAREST) > 0
        return FloorMask(mask, mask, doubtful=sized & ~mask)

    def _as_it_looks(
        self, floor: Mask, seen: Projection, own: _OwnDepth, looks: Float32, upward: Float32 | None
    ) -> Mask:
        """The `floor` beside depth of images with what networks add and take away, all (h, w) but `upward`, which may
        have any size."""
        import cv2

        c, stairs = self.config, self._stairs.at(seen.ground)
        floor = floor & ((looks > np.where(own.level, c.never_thin, c.doubted)) | stairs)
        front = np.zeros_like(floor)
        if upward is not None:
            sized = cv2.resize(upward, (floor.shape[1], floor.shape[0]), interpolation=cv2.INTER_AREA)
            front = cv2.erode((sized < c.wall).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        floor |= seen.unsure & ~own.before & ~front & (looks > c.filled_thin)
        floor |= seen.hidden & ~own.before & ~front & (looks > c.filled_behind)
        return np.asarray(floor & (~front | own.known | (looks >= c.filled_wall) | stairs))

    def _with_depth(self, seen: Projection, camera: Camera, depth: Float32) -> tuple[Mask, _OwnDepth]:
        """The floor of a projection with what the depth of the image says of each pixel, and that."""
        import cv2

        height, width = seen.floor.shape
        own = cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST)
        small = self._small(camera)
        ground = seen.distance * (small.rays() @ small.rotation[:, 2].astype(np.float32))
        known = (own > 0) & (ground > 0)
        level = known & (np.abs(own - ground) < self.config.level * ground)
        before = known & (own < (1 - self.config.before) * ground)
        floor = _without_specks((seen.floor & ~before) | level, self.config.speck)
        return floor, _OwnDepth(level, before, own > 0)

    def likeness(self, camera: Camera, image: Image) -> Float32:
        """(h, w) float32 at the working size, 0 to 1: how much `image` (H, W, 3) looks like floor, by the colours that
        `learn` has seen; without them, by the colours around the floor that geometry shows in the image itself. 0 on
        what stands high: a table may be of the same wood."""
        seen = self.project(camera)
        view = self._glimpse(seen, image)
        if self._appearance is None:
            return grow(seen.floor, seen.floor | seen.unsure | seen.hidden, view.image).astype(np.float32)
        with np.errstate(invalid="ignore"):
            hits = camera.position + seen.before[..., None] * self._small(camera).rays()
            high = hits[..., 2] - self.surface.height_at(np.nan_to_num(hits[..., :2])) > _HIGH
        standing_high = np.isfinite(seen.before) & high & ~seen.floor
        return np.where((seen.distance > 0) & ~standing_high, self._appearance.likeness(view), 0).astype(np.float32)

    @property
    def knows_floor(self) -> bool:
        """Whether the cloud is dense enough to show floor, so that floor it does not show is in doubt."""
        return not self._is_sparse and self._standing.confirmed is not None

    def _glimpse(self, seen: Projection, image: Image) -> Glimpse:
        import cv2

        height, width = seen.floor.shape
        small = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        return Glimpse(seen.floor, seen.ground, seen.distance, small)

    def project(self, camera: Camera) -> Projection:
        """The floor by geometry alone, at the working size."""
        import cv2

        small = self._small(camera)
        rays = small.rays()
        distance = self._stairs.meet(small.position, rays)
        met = distance < self.config.farthest
        distance = np.where(met, distance, 0).astype(np.float32)
        ground = small.position[:2] + distance[..., None] * rays[..., :2]
        floor_depth = distance * (rays @ small.rotation[:, 2].astype(np.float32))
        depth, radius = self._splats.depth(small, farthest=self.config.farthest)
        hidden = ~met | (depth < floor_depth * self.config.margin - 0.003)
        inside = cv2.distanceTransform(hidden.astype(np.uint8), cv2.DIST_L2, 3)
        # Above a foot the floor next to a border lies behind the thing, and the border is a silhouette drawn too large;
        # at a foot the floor lies before it, and the border is where it should be.
        silhouette = met & (depth < floor_depth * self.config.contact)
        hidden &= ~(silhouette & (inside < self.config.shrink * radius * small.intrinsics.fx / depth))
        possible = met
        if self._standing.confirmed is not None:
            possible = met & self._standing.confirmed.at(ground)
        floor: Mask = possible & ~hidden
        floor = _without_specks(floor, self.config.speck)
        nearest = np.minimum(depth, np.where(met, floor_depth, np.inf))
        scale = (camera.intrinsics.fx / nearest).astype(np.float32)
        before = (depth / (rays @ small.rotation[:, 2].astype(np.float32))).astype(np.float32)
        unsure = met & ~hidden & ~floor
        return Projection(floor, possible & ~floor, unsure, scale, ground.astype(np.float32), distance, before)

    def _small(self, camera: Camera) -> Camera:
        return Camera(camera.intrinsics.within(self.config.longest_side), camera.camera_to_world)


def _counted(seen: Projection, usable: Mask | None) -> Projection:
    """A projection (h, w) without the floor where the image (H, W) is not `usable`."""
    import cv2

    if usable is None:
        return seen
    height, width = seen.floor.shape
    sized = cv2.resize(usable.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0.999
    return replace(seen, floor=seen.floor & sized, hidden=seen.hidden & sized, unsure=seen.unsure & sized)


def _without_specks(mask: Mask, area: float) -> Mask:
    """`mask` (H, W) with its regions, and its holes, smaller than `area` (a share of the image) turned over."""
    clean = large_regions(mask, area)
    filled: Mask = ~large_regions(~clean, area)
    return filled
