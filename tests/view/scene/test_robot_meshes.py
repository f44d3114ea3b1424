"""A mesh that cannot be simplified is drawn as its box, with the reason."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import Surface
from rpctl.view.scene import robot_meshes
from rpctl.view.scene.robot_meshes import NOTHING_LEFT, shade_surface

LOW, HIGH = np.array([1.0, 2.0, 3.0]), np.array([1.5, 4.0, 3.0])  # flat
SURFACE = Surface(np.array([LOW, HIGH, [1.0, 4.0, 3.0]]), np.array([[0, 1, 2]]), None)
VERTICES, NORMALS = SURFACE.vertices.astype("<f4"), np.zeros((3, 3), "|i1")
FACES = np.array([[0, 1, 2]], "<u4")


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (MeshError("too slow"), "too slow"),
        ([VERTICES, NORMALS, FACES[:0]], NOTHING_LEFT),
        ([VERTICES, NORMALS], "no mesh"),
        ([VERTICES * 100.0, NORMALS, FACES], "no mesh"),
        ([VERTICES * np.float32(np.nan), NORMALS, FACES], "no mesh"),
        ([VERTICES, NORMALS[:2], FACES], "no mesh"),
        ([VERTICES, NORMALS, FACES + np.uint32(1)], "no mesh"),
        ([VERTICES, NORMALS, FACES], ""),
    ],
)
def test_a_mesh_or_its_box(answer: Any, expected: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def ask(*_: object) -> Any:
        if isinstance(answer, MeshError):
            raise answer
        return {}, answer

    monkeypatch.setattr(robot_meshes, "ask", ask)
    mesh, fault = shade_surface(SURFACE, 100, foreign=True)
    assert expected in fault
    assert bool(fault) == bool(expected)
    assert len(mesh.faces) == (12 if expected else 1)
    assert mesh.vertices[:, :2].min(axis=0) == pytest.approx(LOW[:2])
    assert mesh.vertices[:, :2].max(axis=0) == pytest.approx(HIGH[:2])
    assert mesh.vertices[:, 2] == pytest.approx(3.0, abs=0.011)
