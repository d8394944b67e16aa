"""The geometric provider: floor masks without a network. It projects the floor surface into the image and removes the
parts that the cloud occludes or no evidence confirms. It then aligns the border with the edges of the image."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.sampling import evenly_spaced
from nvsim.geometry.splatting import SplatCloud
from nvsim.perception.appearance import FloorAppearance, FloorObservation
from nvsim.perception.glass import GlassVotes
from nvsim.perception.hybrid import large_regions
from nvsim.perception.obstacles import ObstacleCloud, ObstacleConfig, split_obstacles
from nvsim.perception.refine import RefineConfig, refine
from nvsim.perception.roles import Failure, Float32, FloorMask, Image, Mask
from nvsim.perception.stairs import Stairs

_HIGH = 0.25  # meters above the floor from which on a surface cannot be mistaken for floor
_ALIKE = 0.5  # least similarity of a pixel that can be floor
_SPECK = 0.02  # meters: half-width of a point that occludes almost nothing
_LEAST = 40  # pixels of floor needed to learn colors
_ROUNDS = 3
_UNSURE_IOU, _UNSURE_AREA = 0.6, 0.01  # of an unsure mask: greatest expected IoU, least share of wrong pixels


@dataclass(frozen=True)
class GeometricConfig:
    """obstacles     how obstacles are found; floor beyond their greatest distance is left out, because one pixel covers
                  too much of it
    longest_side  pixels of the image in which occlusion is computed
    shrink        share of that half-width removed from silhouettes, because the squares overhang the object
    contact       a point nearer than this share of the distance to the floor behind it is a silhouette, not a foot
    margin        share of the distance to the floor beyond which a point does not occlude it
    speck         regions and holes smaller than this share of the image are noise of the cloud
    level         a pixel shows floor if its own depth differs from that of the floor by less than this share
    before        a pixel shows an object if it is nearer than the floor by more than this share
    glimpses      greatest number of views from which the color of the floor is learned
    filled        unoccluded, unconfirmed pixels are floor above this probability of the semantic network
    edge          pixels beside floor by which objects are drawn too large
    filled_edge   with a LiDAR scan, occluded pixels within `edge` are floor above this probability
    never         with a LiDAR scan, floor below this probability is removed, except on stairs: people, feet of panes
    never_edge    replaces `never` for floor within `rim` pixels of other surfaces
    rim           pixels, see `never_edge`
    usual         floor with an unusual color is kept above this probability: gloss, the light of a lamp
    filled_thin   replaces `filled` if the cloud comes from images, which have few points on plain floor
    usual_thin    replaces `usual` if the cloud comes from images, which have few points on dark cupboards
    filled_behind  with a cloud from images, occluded pixels are floor above this probability: thin objects are too
                   thick
    doubted       with a cloud from images, unoccluded floor below this probability is removed: near walls have holes
    never_thin    replaces `doubted` if the image's own depth agrees with the floor, as it wrongly can on plain walls
    wall          upward component of the network's normals below which a pixel is a wall or another vertical surface;
                  without own depth in the image, unconfirmed floor is not added there
    filled_wall   and confirmed floor on such a surface is removed below this probability
    """

    obstacles: ObstacleConfig = ObstacleConfig()
    longest_side: int = 320
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
    refine: RefineConfig = RefineConfig()


@dataclass(frozen=True, eq=False)
class Projection:
    """The geometric part of the floor segmentation of a view, at the working size.

    floor     (h, w) bool, visible and confirmed
    hidden    (h, w) bool, confirmed floor that is occluded or removed as a speck
    unsure    (h, w) bool, unoccluded floor without confirmation
    scale     (h, w) float32, pixels of the full image per meter
    ground    (h, w, 2) float32, meters, the points where the rays meet the floor surface
    distance  (h, w) float32, meters along the rays to those points, 0 if they do not meet it
    before    (h, w) float32, meters along the rays to the nearest object, inf if there is none
    """

    floor: Mask
    hidden: Mask
    unsure: Mask
    scale: Float32
    ground: Float32
    distance: Float32
    before: Float32


class _DepthMasks(NamedTuple):
    """Masks (h, w) bool from the depth of an image: pixels at the depth of the floor, pixels before the floor, and
    pixels with a known depth."""

    level: Mask
    before: Mask
    known: Mask


class GeometricFloor:
    """A FloorSegmenter that uses a point cloud (or None) and the floor surface around the cameras."""

    def __init__(
        self,
        cloud: Cloud | None,
        surface: FloorSurface,
        config: GeometricConfig | None = None,
        obstacles: ObstacleCloud | None = None,
    ) -> None:
        """`obstacles` are those of the cloud around the cameras, by default of the whole cloud."""
        self.config = config or GeometricConfig()
        self.surface, self._stairs = surface, Stairs.of(surface)
        self._appearance: FloorAppearance | None = None
        self._is_sparse = cloud is not None and not cloud.is_dense
        found = obstacles or split_obstacles(cloud, surface, self.config.obstacles)
        self._confirmed, self._splats = found.confirmed, SplatCloud.of(found.points, found.radii)

    def learn(
        self,
        cameras: Sequence[Camera],
        read: Callable[[int], Image],
        threads: int = 1,
        usable_of: Callable[[int], Mask | None] = lambda index: None,
    ) -> None:
        """Learns the color of the floor from views spread over the trajectory, and finds glass.

        `read` gives the image (H, W, 3) uint8 RGB of the camera at an index. `usable_of` gives its valid pixels (h, w)
        bool at any size, None for all. Both are called in `threads` threads. Without this call, objects that the cloud
        misses stay in the masks."""
        chosen = evenly_spaced(len(cameras), self.config.glimpses)

        def observe_view(index: int) -> tuple[Projection, FloorObservation]:
            projection = _without_ignored(self.project(cameras[index]), usable_of(index))
            return projection, self._observe_floor(projection, read(index))

        kept: list[tuple[Mask, Float32, Float32, Image]] = []  # half of the memory of a projection

        def observations() -> Iterator[FloorObservation]:
            with ThreadPoolExecutor(threads) as pool:
                for projection, view in pool.map(observe_view, chosen):
                    kept.append((projection.hidden, projection.before, projection.distance, view.image))
                    yield view

        self._appearance = FloorAppearance.learn(observations())
        if self._appearance is None:
            return
        through = GlassVotes()
        for i, (hidden, before, distance, image) in zip(chosen, kept, strict=True):
            camera = self._working_camera(cameras[i])
            rays = camera.rays()
            expected, known = self._appearance.expected_colors(
                _ground_points(camera, rays, distance).astype(np.float32)
            )
            hits = (camera.position + before[..., None] * rays).astype(np.float32)
            seen = self._appearance.log_colors(image)
            through.add_votes(seen, expected, hidden & known & np.isfinite(before), hits, distance - before)
        glass = through.glass(self._splats.points)
        self._splats.radii[glass] = np.minimum(self._splats.radii[glass], _SPECK)

    def segment(
        self, camera: Camera, image: Image, depth: Float32 | None = None, looks: Float32 | None = None,
        upward: Float32 | None = None,
    ) -> FloorMask:  # fmt: skip
        """The floor of an undistorted image (H, W, 3) uint8 RGB seen by `camera`.

        depth   (h, w) of any size, meters along the optical axis, 0 if unknown: the image's own depth. It overrides the
                cloud. Unconfirmed pixels that look like floor become doubtful.
        looks   (H, W) 0 to 1, a network's floor probability. It fills unoccluded, unconfirmed floor and decides at the
                edges of objects. If it leaves much of the mask open, the mask's failure is "unsure".
        upward  (H, W) the world's z of a network's normals. Vertical surfaces without own depth are not floor.
        """
        import cv2

        seen = self.project(camera)
        floor, own = seen.floor, _DepthMasks(*np.zeros((3, *seen.floor.shape), bool))
        if depth is not None:
            floor, own = self._with_depth(seen, camera, depth)
        view = self._observe_floor(seen, image)
        small: Float32 | None = None
        if looks is not None and self.has_dense_cloud:
            shown = cv2.resize(looks, (floor.shape[1], floor.shape[0]), interpolation=cv2.INTER_AREA)
            small = np.asarray(shown, np.float32)
        if self._is_sparse:
            floor = grow(floor, seen.floor | seen.unsure, view.image)
        elif self._appearance is not None:
            usual = ~self._appearance.unusual_regions(view)
            if small is not None:
                usual |= small > (self.config.usual if depth is None else self.config.usual_thin)
            floor = floor & (own.level | self._stairs.is_on_stairs(seen.ground) | usual)
            floor |= self._appearance.glass_regions(view, seen.hidden)
        if small is not None:
            if depth is None:
                rim = cv2.distanceTransform(floor.astype(np.uint8), cv2.DIST_L2, 3) < self.config.rim
                least = np.where(rim, self.config.never_edge, self.config.never)
                floor &= (small > least) | self._stairs.is_on_stairs(seen.ground)
                floor |= seen.unsure & (small > self.config.filled)
                beside = cv2.distanceTransform((~floor).astype(np.uint8), cv2.DIST_L2, 3) < self.config.edge
                floor |= seen.hidden & beside & (small > self.config.filled_edge)
            else:
                floor = self._as_it_looks(floor, seen, own, small, upward)
        mask = refine(floor, seen.scale, image, self.config.refine)
        failure: Failure = "unsure" if small is not None and _is_unsure(mask, seen, own, small) else ""
        if depth is None or self._appearance is None:
            return FloorMask(mask, mask, failure=failure)
        alike = self._appearance.similarity(view) > _ALIKE
        doubtful = ((seen.floor | seen.unsure) & ~own.before & alike).astype(np.uint8)
        sized = cv2.resize(doubtful, (mask.shape[1], mask.shape[0]), interpolation=cv2.INTER_NEAREST) > 0
        return FloorMask(mask, mask, doubtful=sized & ~mask, failure=failure)

    def _as_it_looks(
        self, floor: Mask, seen: Projection, own: _DepthMasks, looks: Float32, upward: Float32 | None
    ) -> Mask:
        """The `floor` from the depth of images, with the additions and removals of networks; all (h, w), except
        `upward`, which can have any size."""
        import cv2

        c, stairs = self.config, self._stairs.is_on_stairs(seen.ground)
        floor = floor & ((looks > np.where(own.level, c.never_thin, c.doubted)) | stairs)
        front = np.zeros_like(floor)
        if upward is not None:
            sized = cv2.resize(upward, (floor.shape[1], floor.shape[0]), interpolation=cv2.INTER_AREA)
            front = cv2.erode((sized < c.wall).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        floor |= seen.unsure & ~own.before & ~front & (looks > c.filled_thin)
        floor |= seen.hidden & ~own.before & ~front & (looks > c.filled_behind)
        return np.asarray(floor & (~front | own.known | (looks >= c.filled_wall) | stairs))

    def _with_depth(self, seen: Projection, camera: Camera, depth: Float32) -> tuple[Mask, _DepthMasks]:
        """The floor of a projection after the image's own depth is applied, and the masks of that depth."""
        import cv2

        height, width = seen.floor.shape
        own = cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST)
        small = self._working_camera(camera)
        ground = seen.distance * (small.rays() @ small.rotation[:, 2].astype(np.float32))
        known = (own > 0) & (ground > 0)
        level = known & (np.abs(own - ground) < self.config.level * ground)
        before = known & (own < (1 - self.config.before) * ground)
        floor = _without_specks((seen.floor & ~before) | level, self.config.speck)
        return floor, _DepthMasks(level, before, own > 0)

    def similarity(self, camera: Camera, image: Image) -> Float32:
        """(h, w) float32 at the working size, 0 to 1: how similar `image` (H, W, 3) is to floor, by the colors that
        `learn` found. Without those, by the colors around the floor that geometry shows in the image itself. High
        surfaces get 0, because a table can have the wood of the floor."""
        seen = self.project(camera)
        view = self._observe_floor(seen, image)
        if self._appearance is None:
            return grow(seen.floor, seen.floor | seen.unsure | seen.hidden, view.image).astype(np.float32)
        possible = (seen.distance > 0) & ~self._high_objects(seen, camera)
        return np.where(possible, self._appearance.similarity(view), 0).astype(np.float32)

    def certain(self, camera: Camera, depth: Float32 | None = None) -> tuple[Mask, Mask]:
        """The pixels (h, w) bool at the working size that certainly show floor, and those that certainly show an object
        before the floor. `depth` is the image's own, see `segment`; with it, both must agree with it."""
        seen = self.project(camera)
        floor, high = seen.floor, (seen.distance > 0) & self._high_objects(seen, camera)
        if depth is None:
            return floor, high
        found, own = self._with_depth(seen, camera, depth)
        return found & own.level, high & own.before & ~found

    def _high_objects(self, seen: Projection, camera: Camera) -> Mask:
        """(h, w) bool, pixels that show a point of the cloud that is too high to be mistaken for floor."""
        with np.errstate(invalid="ignore"):
            hits = camera.position + seen.before[..., None] * self._working_camera(camera).rays()
            high = hits[..., 2] - self.surface.height_at(np.nan_to_num(hits[..., :2])) > _HIGH
        return np.asarray(np.isfinite(seen.before) & high & ~seen.floor)

    @property
    def has_dense_cloud(self) -> bool:
        """Whether the cloud is dense enough to show floor, so that floor without points is doubtful."""
        return not self._is_sparse and self._confirmed is not None

    def _observe_floor(self, seen: Projection, image: Image) -> FloorObservation:
        import cv2

        height, width = seen.floor.shape
        small = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        return FloorObservation(seen.floor, seen.ground, seen.distance, small)

    def project(self, camera: Camera) -> Projection:
        """The floor by geometry alone, (h, w) arrays at the working size."""
        import cv2

        small = self._working_camera(camera)
        rays = small.rays()
        distance = self._stairs.distance_along_rays(small.position, rays)
        met = distance < self.config.obstacles.farthest
        distance = np.where(met, distance, 0).astype(np.float32)
        ground = _ground_points(small, rays, distance)
        floor_depth = distance * (rays @ small.rotation[:, 2].astype(np.float32))
        depth, radius = self._splats.depth(small, farthest=self.config.obstacles.farthest)
        hidden = ~met | (depth < floor_depth * self.config.margin - 0.003)
        inside = cv2.distanceTransform(hidden.astype(np.uint8), cv2.DIST_L2, 3)
        # Above the foot of an object, the floor beside its border is behind it, and the border is a silhouette drawn
        # too large. At the foot, the floor beside it is before it, and the border is correct.
        silhouette = met & (depth < floor_depth * self.config.contact)
        hidden &= ~(silhouette & (inside < self.config.shrink * radius * small.intrinsics.fx / depth))
        possible = met
        if self._confirmed is not None:
            possible = met & self._confirmed.is_supported(ground)
        floor: Mask = possible & ~hidden
        floor = _without_specks(floor, self.config.speck)
        nearest = np.minimum(depth, np.where(met, floor_depth, np.inf))
        scale = (camera.intrinsics.fx / nearest).astype(np.float32)
        before = (depth / (rays @ small.rotation[:, 2].astype(np.float32))).astype(np.float32)
        unsure = met & ~hidden & ~floor
        return Projection(floor, possible & ~floor, unsure, scale, ground.astype(np.float32), distance, before)

    def _working_camera(self, camera: Camera) -> Camera:
        return Camera(camera.intrinsics.limited_to(self.config.longest_side), camera.camera_to_world)


def _ground_points(camera: Camera, rays: Float32, distance: Float32) -> NDArray[np.float64]:
    """(h, w, 2) x and y of the points `distance` (h, w) meters along the `rays` (h, w, 3) of a camera."""
    return np.asarray(camera.position[:2] + distance[..., None] * rays[..., :2], np.float64)


def _is_unsure(mask: Mask, seen: Projection, own: _DepthMasks, looks: Float32) -> bool:
    """Whether much of the `mask` (H, W) may be wrong, by the probability `looks` (h, w) where geometry decides nothing.

    If pixels are independent, the expected IoU is about the expected intersection over the expected union."""
    import cv2

    certain = own.level if own.known.any() else seen.floor
    possible = (seen.floor | seen.hidden | seen.unsure) & ~own.before
    likely = np.where(certain, 1, np.where(possible, looks, 0))
    size = (likely.shape[1], likely.shape[0])
    found = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    both, missed = float(likely[found].sum()), float(likely[~found].sum())
    either = float(found.sum()) + missed
    return both < _UNSURE_IOU * either and either - both > _UNSURE_AREA * found.size


def _without_ignored(seen: Projection, usable: Mask | None) -> Projection:
    """A projection (h, w) without the floor of pixels (H, W) that are not `usable`."""
    import cv2

    if usable is None:
        return seen
    height, width = seen.floor.shape
    sized = cv2.resize(usable.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0.999
    return replace(seen, floor=seen.floor & sized, hidden=seen.hidden & sized, unsure=seen.unsure & sized)


def _without_specks(mask: Mask, area: float) -> Mask:
    """`mask` (H, W) with regions and holes smaller than `area` (a share of the image) inverted."""
    clean = large_regions(mask, area)
    filled: Mask = ~large_regions(~clean, area)
    return filled


def grow(confirmed: Mask, possible: Mask, image: Image) -> Mask:
    """(h, w) bool: floor by GrabCut. `confirmed` (h, w) bool is floor, pixels that are not `possible` (h, w) bool are
    not. `image` is (h, w, 3) uint8 RGB. Only regions that contain confirmed floor are kept."""
    import cv2

    seeds = confirmed & possible
    if seeds.sum() < _LEAST or not (~possible).any():
        return seeds
    labels = np.full(image.shape[:2], cv2.GC_BGD, np.uint8)
    labels[possible] = cv2.GC_PR_BGD
    near = cv2.dilate(seeds.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
    labels[possible & near] = cv2.GC_PR_FGD
    labels[cv2.erode(seeds.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0] = cv2.GC_FGD
    if not (labels == cv2.GC_FGD).any():
        return seeds
    cv2.setRNGSeed(0)  # GrabCut's first clusters are random
    models = np.zeros((1, 65)), np.zeros((1, 65))
    found, *_ = cv2.grabCut(image, labels, (0, 0, 1, 1), *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    grown = ((found == cv2.GC_FGD) | (found == cv2.GC_PR_FGD)) & possible
    _, regions = cv2.connectedComponents(grown.astype(np.uint8))
    held = np.unique(regions[seeds & grown])
    kept: Mask = np.isin(regions, held[held > 0])
    return kept
