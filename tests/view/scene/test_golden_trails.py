"""Trails and the ground's grid as numbers: where each corner is, and which dash covers what."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from rpctl.view.scene import stage as ground
from rpctl.view.scene import trails
from rpctl.view.scene.trails import dashes, fresh_dashes
from tests.view.readers import trails as drawn_trails

Array = np.ndarray[Any, Any]


def test_a_band_is_level_and_as_wide_as_asked() -> None:
    path = np.array([[0.0, 0.0, 0.1], [1.0, 0.0, 0.2], [1.0, 0.0, 0.3], [1.0, 2.0, 0.4]])
    mesh = trails.ribbon(path, 0.2)
    assert mesh is not None
    vertices, faces = mesh
    left, right = vertices[0::2], vertices[1::2]
    assert 0.5 * (left + right) == pytest.approx(path)
    assert np.linalg.norm(left - right, axis=1) == pytest.approx([0.2] * 4)
    assert (left - right)[:, 2] == pytest.approx([0.0] * 4)
    assert (left - right)[0] == pytest.approx([0.0, 0.2, 0.0])  # left of +x is +y
    assert (left - right)[3] == pytest.approx([-0.2, 0.0, 0.0])
    assert faces.tolist() == [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 6], [5, 7, 6]]


def test_a_pause_keeps_the_direction_before_it() -> None:
    """And one at the start that after it."""
    path = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0]], float)
    mesh = trails.ribbon(path, 2.0)
    assert mesh is not None
    assert mesh[0][0::2] - path == pytest.approx(np.tile([0.0, 1.0, 0.0], (6, 1)))


@pytest.mark.parametrize("lead", [(1.0, 0.2, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.3)])
def test_a_tube_is_round_about_its_path(lead: tuple[float, float, float]) -> None:
    along = np.linspace(0.0, 3.0, 9)[:, None]
    bend = 0.3 * np.column_stack([np.sin(along), np.cos(2.0 * along), np.sin(3.0 * along)])
    path = along * lead + bend
    mesh = trails.tube(path, 0.1)
    assert mesh is not None
    vertices, faces = mesh
    rings = vertices.reshape(9, trails.TUBE_SIDES, 3)
    assert rings.mean(axis=1) == pytest.approx(path)
    spokes = rings - path[:, None]
    assert np.linalg.norm(spokes, axis=2) == pytest.approx(np.full((9, trails.TUBE_SIDES), 0.05))
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    assert np.einsum("kij,kj->ki", spokes, tangents) == pytest.approx(0.0, abs=1e-12)
    following = np.roll(spokes, -1, axis=1)
    assert np.einsum("kij,kij->ki", spokes, following) == pytest.approx(0.5 * 0.05**2)  # 60° apart
    for ring, after in pairwise(spokes):
        turn = np.einsum("ij,ij->i", ring, after) / 0.05**2
        assert turn.min() > 0.5  # it is never twisted by a sixth of a turn
    assert len(faces) == 8 * trails.TUBE_SIDES * 2
    assert sorted(set(faces.ravel().tolist())) == list(range(len(vertices)))
    steps = faces.reshape(8, -1)
    for k, used in enumerate(steps):  # a part of the triangles is a part of the way
        assert used.min() == k * trails.TUBE_SIDES
        assert used.max() == (k + 2) * trails.TUBE_SIDES - 1


def test_dashes_cover_seven_of_twelve_widths() -> None:
    """A way of 2.5 m, dashes of 0.7 m and gaps of 0.5 m: from 0, 1.2 and 2.4 m on."""
    path = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1.5, 0]], float)
    pieces = trails.dashes(path, 0.1)
    assert [piece.tolist() for piece in pieces] == [
        [pytest.approx([0.0, 0.0, 0.0]), pytest.approx([0.7, 0.0, 0.0])],
        [pytest.approx([1.0, 0.2, 0.0]), pytest.approx([1.0, 0.9, 0.0])],
        [pytest.approx([1.0, 1.4, 0.0]), pytest.approx([1.0, 1.5, 0.0])],
    ]
    (first, *_) = trails.dashes(path, 0.2)
    assert first.tolist() == [
        pytest.approx([0.0, 0.0, 0.0]),
        pytest.approx([1.0, 0.0, 0.0]),  # a dash goes round the corner
        pytest.approx([1.0, 0.4, 0.0]),
    ]


def test_grid_lies_on_whole_steps_and_fades_out() -> None:
    points, opacity = ground.grid_lines(np.array([3.1, -2.1]), 2.2, 0.5, -0.25)
    assert set(points[:, 2]) == {-0.25}
    starts, ends = points[0::2], points[1::2]
    level = np.isclose(starts[:, 0], ends[:, 0])
    assert (level | np.isclose(starts[:, 1], ends[:, 1])).all()
    lines = np.where(level, starts[:, 0], starts[:, 1]) / 0.5
    assert lines == pytest.approx(np.round(lines))
    assert np.linalg.norm(ends - starts, axis=1) == pytest.approx(
        2 * 2.5 / (2 * ground.GRID_PIECES)
    )
    away = np.linalg.norm(points[:, :2] - [3.0, -2.0], axis=1) / 2.5
    assert opacity == pytest.approx(np.clip(1.0 - away, 0.0, 1.0) ** 1.2)
    assert opacity.max() == 1.0
    assert (opacity.reshape(-1, 2).max(axis=1) > 0.0).all()
    assert set(np.round(lines[level]).astype(int)) == set(range(2, 11))  # four on each side of 6
    assert set(np.round(lines[~level]).astype(int)) == set(range(-8, 1))  # and of -4


def test_trails_lie_above_the_ground_and_the_actual_above_the_desired() -> None:
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    paths = {
        "base": path,
        "base-desired": path,
        "tip": path + np.array([0.0, 0.0, 1.0]),
        "tip-desired": path,
    }
    lower, upper = np.zeros(3), np.array([3.0, 4.0, 1.0])  # a trail of 30 mm
    drawn = {name.removeprefix("trail-"): points for name, points in found(paths, lower, upper)}
    heights = {name: 0.5 * (p[:, 2].min() + p[:, 2].max()) for name, p in drawn.items()}
    widths = {name: np.ptp(points[:, 1]) for name, points in drawn.items()}
    assert heights == pytest.approx(
        {"base-desired": 0.009, "base": 0.018, "tip-desired": 0.0, "tip": 1.0}, abs=1e-7
    )
    assert widths["base"] == pytest.approx(0.03)
    assert widths["base-desired"] == pytest.approx(0.8 * 0.03)
    for name, width in (("tip", 0.55 * 0.03), ("tip-desired", 0.8 * 0.55 * 0.03)):
        assert np.sqrt(0.75) * width * 0.999 < widths[name] <= width * 1.001
    still = {"base": path[:1], "base-desired": path}
    assert [name for name, _ in found(still, lower, upper)] == ["trail-base-desired"]


def found(paths: dict[str, Array], lower: Array, upper: Array) -> list[tuple[str, Array]]:
    """Return the vertices (n, 3) of the trails of paths, by their nodes' names."""
    return list(drawn_trails([trails.trails_command({"": paths}, lower, upper)]).items())


def test_laps_on_one_another_have_the_dashes_of_one() -> None:
    """Those of a single lap, of a path that crosses itself, all stay."""
    angle = np.linspace(0.0, 6.0 * np.pi, 3001)
    path = np.column_stack([np.sin(angle), np.sin(2.0 * angle), np.zeros(len(angle))])
    one = path[:991]  # not quite a lap: a dash that closes it would lie on the first
    assert [len(p) for p in fresh_dashes(one, 0.02)] == [len(p) for p in dashes(one, 0.02)]
    shown, whole = fresh_dashes(path, 0.02), dashes(path, 0.02)
    assert len(whole) > 2.9 * len(dashes(one, 0.02))
    assert abs(len(shown) - len(dashes(one, 0.02))) <= 2
    for piece, other in zip(shown, whole, strict=False):
        np.testing.assert_array_equal(piece, other)
    back = np.vstack([path[:500], path[499::-1]])  # there and back is one line, too
    assert len(fresh_dashes(back, 0.02)) <= len(dashes(path[:500], 0.02)) + 2
