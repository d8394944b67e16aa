"""Compare the alpha of floor cells that the map builder reads with that of views straight at the cells.

Splats are rendered with an approximation that is exact on the axis of a view. Its error grows with the distance from
the axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, camera_pose
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS, Corridor, HeightAt, SupportAt, headings, offset_ahead
from nvsim.mapping.criteria import corridor_of
from nvsim.mapping.views.floor_view import measure
from nvsim.mapping.views.view_sources import render_pitched_views
from nvsim.project.scene_views import SceneViews
from nvsim.render.model import render_model
from nvsim.splats.scene import SceneModel

_PLACES = 24  # positions of the trajectory with one corridor each
_EVERY = 3  # every third row and cell of the corridor is tested
_SIDE, _FOCAL = 16, 98.0  # pixels, as in a panorama of width 512


def off_straight(
    scene: SceneModel,
    source: SceneViews,
    trajectory: NDArray[np.floating],
    floor: HeightAt,
    support: SupportAt,
    config: MappingConfig,
) -> tuple[float, float]:
    """Mean and mean absolute difference between the alpha that is read and the alpha of a straight view.

    The cells are those of corridors along the `trajectory` (N, 3), meters."""
    apart: list[float] = []
    for i, place in enumerate(trajectory[:: max(1, len(trajectory) // _PLACES)][:_PLACES]):
        k = i % DIRECTIONS
        target = place[:2] + offset_ahead(headings(config)[k], config.tau_dist)
        corridor = Corridor((place[0], place[1]), (target[0], target[1]), place[2])
        view = render_pitched_views(source, place, {k: [corridor]}, floor, config)[k]
        evidence = measure(view, "", k, corridor, floor, support)
        part, model = corridor_of(evidence, config), scene.model(evidence.submap)
        ground, alpha = corridor.ground(floor)[part], evidence.alpha[part] / 255
        for row in range(0, len(ground), _EVERY):
            for cell in range(0, ground.shape[1], _EVERY):
                x, y, z = ground[row, cell] - place
                pose = camera_pose(place, float(np.arctan2(x, y)), float(np.arctan2(z, np.hypot(x, y))))
                camera = Camera(Intrinsics(_SIDE, _SIDE, _FOCAL, _FOCAL, _SIDE / 2, _SIDE / 2), pose)
                seen = render_model(model, camera, frozenset({"alpha"})).alpha
                assert seen is not None
                middle = slice(_SIDE // 2 - 1, _SIDE // 2 + 1)
                apart.append(float(alpha[row, cell]) - float(seen[middle, middle].mean()))
    return round(float(np.mean(apart)), 4), round(float(np.abs(apart).mean()), 4)
