from __future__ import annotations

import numpy as np
import pytest
import trimesh

from rpctl.description.meshes.jobs import shade, simplify, weld


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
