"""The faces of a skybox against the table of directions that was confirmed with the compiled simulator."""

import numpy as np

from nvsim.geometry.directions import NAMES, face_axes, face_rays

CONFIRMED = {
    "up": lambda u, r: (-u, -1, -r),
    "back": lambda u, r: (-u, r, -1),
    "left": lambda u, r: (-1, r, u),
    "front": lambda u, r: (u, r, 1),
    "right": lambda u, r: (1, r, -u),
    "down": lambda u, r: (-u, 1, r),
}


def test_rays_are_those_of_the_confirmed_table():
    rays, along = face_rays(4), (-0.75, -0.25, 0.25, 0.75)
    for face, name in enumerate(NAMES):
        expected = [[CONFIRMED[name](u, r) for u in along] for r in along]
        np.testing.assert_allclose(rays[face], expected)


def test_every_face_is_a_rotation_of_the_front():
    np.testing.assert_allclose(np.linalg.det(face_axes()), 1)
    np.testing.assert_allclose(face_axes()[3], np.eye(3))
