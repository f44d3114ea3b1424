from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from rpctl.view.scene import motion

TIMES = np.linspace(0.0, 4.0, 121)


def wandering(rng: np.random.Generator, size: int) -> np.ndarray[Any, Any]:
    """Return smooth motions (121, size) of about 0.3 m or rad."""
    rates, phases = rng.uniform(0.2, 1.0, size), rng.uniform(0.0, 6.0, size)
    return 0.3 * np.sin(TIMES[:, None] * rates + phases)


def test_positions_between_the_frames_kept_are_near(rng: np.random.Generator) -> None:
    values = wandering(rng, 3)
    kept = motion.position_keyframes(TIMES, values)
    filled = [np.interp(TIMES, TIMES[kept], column[kept]) for column in values.T]
    gaps = np.linalg.norm(np.array(filled).T - values, axis=1)
    assert 0.1 * motion.POSITION_TOLERANCE_M < gaps.max() <= motion.POSITION_TOLERANCE_M
    assert len(kept) < 0.5 * len(TIMES)
    assert (kept[0], kept[-1]) == (0, len(TIMES) - 1)


def test_turns_between_the_frames_kept_are_near(rng: np.random.Generator) -> None:
    turns = Rotation.from_rotvec(wandering(rng, 3))
    signs = rng.choice([-1.0, 1.0], (len(TIMES), 1))  # either quaternion of a turn may come
    kept = motion.rotation_keyframes(TIMES, signs * turns.as_quat())
    filled = Slerp(TIMES[kept], turns[kept])(TIMES)
    gaps = (filled.inv() * turns).magnitude()
    assert (
        0.1 * motion.ROTATION_TOLERANCE_RAD < gaps.max() <= 1.0001 * motion.ROTATION_TOLERANCE_RAD
    )
    assert len(kept) < 0.5 * len(TIMES)


def test_steady_motion_needs_its_ends_only() -> None:
    line = TIMES[:, None] * [1.0, -2.0, 0.5]
    assert motion.position_keyframes(TIMES, line).tolist() == [0, 120]
    turn = Rotation.from_rotvec(TIMES[:, None] * [0.0, 0.3, 0.0]).as_quat()
    assert motion.rotation_keyframes(TIMES, turn).tolist() == [0, 120]


def test_wheel_that_spins_is_not_taken_for_one_that_stands() -> None:
    spin = Rotation.from_rotvec(TIMES[:, None] * [0.0, 2.0 * np.pi, 0.0])
    kept = motion.rotation_keyframes(TIMES, spin.as_quat())
    assert 2.0 * np.pi * np.diff(TIMES[kept]).max() < motion.MAX_STEP_RAD
