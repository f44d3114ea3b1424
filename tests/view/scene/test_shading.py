from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rpctl.description.meshes.jobs import shade, simplify, weld
from rpctl.view.scene import trails


def test_edges_of_a_box_stay_sharp() -> None:
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    shaded = shade(*weld(np.asarray(box.vertices), np.asarray(box.faces)))
    assert len(shaded.vertices) == 24
    assert (np.sort(np.abs(shaded.normals), axis=1) == [0, 0, 127]).all()


def test_ball_is_smooth_and_its_normals_point_outwards() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    shaded = shade(*weld(np.asarray(ball.vertices), np.asarray(ball.faces)))
    assert len(shaded.vertices) == len(ball.vertices)
    assert (shaded.normals / 127.0 - shaded.vertices) == pytest.approx(0.0, abs=0.02)


def test_simplified_mesh_keeps_its_shape() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5)
    vertices, faces = simplify(np.asarray(ball.vertices), np.asarray(ball.faces), 1500)
    assert len(faces) <= 1500
    assert np.linalg.norm(vertices, axis=1) == pytest.approx(1.0, abs=0.02)


def test_small_mesh_is_left_as_it_is() -> None:
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    assert len(simplify(np.asarray(box.vertices), np.asarray(box.faces), 1500)[1]) == 12


CIRCLE = np.column_stack(
    [np.cos(np.linspace(0, 6, 200)), np.sin(np.linspace(0, 6, 200)), np.full(200, 0.4)]
)


def test_ribbon_is_level_and_as_wide_as_asked() -> None:
    mesh = trails.ribbon(CIRCLE, 0.1)
    assert mesh is not None
    radii = np.linalg.norm(mesh[0][:, :2], axis=1).reshape(-1, 2)
    assert np.sort(radii, axis=1) == pytest.approx(np.tile([0.95, 1.05], (200, 1)), abs=1e-3)
    assert mesh[0][:, 2] == pytest.approx(0.4)


def test_tube_keeps_its_distance() -> None:
    mesh = trails.tube(CIRCLE, 0.1)
    assert mesh is not None
    gaps = np.linalg.norm(mesh[0].reshape(200, -1, 3) - CIRCLE[:, None], axis=2)
    assert gaps == pytest.approx(0.05)


def test_parts_of_a_trail_are_parts_of_the_way() -> None:
    mesh = trails.tube(CIRCLE, 0.1)
    assert mesh is not None
    per_step = len(mesh[1]) // (len(CIRCLE) - 1)
    assert mesh[1][: 10 * per_step].max() < 11 * trails.TUBE_SIDES


def test_dashes_cover_their_share_of_a_line() -> None:
    line = np.linspace([0.0, 0.0, 0.0], [10.0, 0.0, 0.0], 7)
    pieces = trails.dashes(line, 0.05)
    covered = sum(float(np.linalg.norm(piece[-1] - piece[0])) for piece in pieces)
    assert covered / 10.0 == pytest.approx(
        trails.DASH_WIDTHS / (trails.DASH_WIDTHS + trails.GAP_WIDTHS), abs=0.05
    )


@pytest.mark.parametrize("count", [1, 2, 50])
def test_standing_still_draws_nothing(count: int) -> None:
    still = np.zeros((count, 3))
    assert trails.ribbon(still, 0.1) is None
    assert trails.tube(still, 0.1) is None
    assert trails.join([trails.ribbon(piece, 0.1) for piece in trails.dashes(still, 0.1)]) is None
