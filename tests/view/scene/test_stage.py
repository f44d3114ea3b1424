from __future__ import annotations

import numpy as np
import pytest

from rpctl.arrays import Array
from rpctl.view.scene.stage import FIELD_OF_VIEW, FILLED_RATIO, Camera, fit_camera, view_axes


def picture(camera: Camera, points: Array, aspect: float) -> Array:
    """Return where points are in the picture (n, 2), its edges at -1 and 1."""
    right, up, back = view_axes(camera.eye - camera.target)
    ahead = (points - camera.eye) @ -back
    slope = np.tan(np.radians(0.5 * FIELD_OF_VIEW))
    seen = np.column_stack([(points - camera.eye) @ right / aspect, (points - camera.eye) @ up])
    return np.asarray(seen / (slope * ahead[:, None]))


@pytest.mark.parametrize("aspect", [0.5, 1.0, 16 / 9])
def test_all_points_are_in_the_picture_and_fill_it(aspect: float, rng: np.random.Generator) -> None:
    for _ in range(20):
        points = rng.normal(size=(30, 3)) * rng.uniform(0.2, 4.0, 3) + rng.normal(size=3) * 5.0
        seen = np.abs(picture(fit_camera(points, aspect), points, aspect))
        assert seen.max() == pytest.approx(FILLED_RATIO)


def test_the_camera_is_level_and_above(rng: np.random.Generator) -> None:
    camera = fit_camera(rng.normal(size=(30, 3)), 1.5)
    right, up, _ = view_axes(camera.eye - camera.target)
    assert right[2] == pytest.approx(0.0)
    assert up[2] > 0.0
    assert camera.eye[2] > camera.target[2]


def test_one_point_is_seen_from_a_distance() -> None:
    camera = fit_camera(np.zeros((1, 3)), 1.5)
    assert np.linalg.norm(camera.eye - camera.target) == pytest.approx(camera.depth)
    assert camera.depth > 0.0
