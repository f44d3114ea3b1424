"""Robots whose numbers are out of scale, each with a model that is right.

Long chains, heavy and light ends, wide tracks, far origins, short casters, motors left out: what
rounding and truncation do to them is no fault of the equations, and the certificate must say so.

``python -m tests.equivalence.ill_scaled`` prints which checks fail, and the nearest to its limit.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import rpctl
from rpctl import Robot
from tests import urdf
from tests.robots import SET_A, platform, write
from tests.vehicles import vehicle

SAMPLES = 5


def link(name: str, mass: float, length: float, rng: np.random.Generator) -> str:
    """Return a link of a general inertia: a body of ``mass`` (kg) some ``length`` (m) long."""
    a, b, c = mass * length**2 * rng.uniform(0.02, 0.09, 3)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    I = R @ np.diag([b + c, c + a, a + b]) @ R.T  # noqa: E741 (the field's letter)
    products = I[0, 1], I[0, 2], I[1, 2]
    centre = length * rng.uniform([0.3, -0.1, -0.1], [0.6, 0.1, 0.1])
    return urdf.link(name, urdf.inertial(mass, np.diag(I), products, centre))


def arm(masses: list[float], length: float = 0.2, seed: int = 0, kinds: str = "r") -> str:
    """Return a serial arm on ``base``: one joint a mass, of ``kinds`` in turn (r or p)."""
    rng, parent, parts = np.random.default_rng(seed), "base", []
    for k, mass in enumerate(masses):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        slide = kinds[k % len(kinds)] == "p"
        reach = 0.5 * length if slide else 2.5
        kind, limit = "prismatic" if slide else "revolute", urdf.limit(-reach, reach, 100, 3)
        place = (length, 0.01, 0.02) if k else (0.1, 0.05, 2 * SET_A["r"] + 0.3)
        ends, turn = (parent, f"link_{k}"), (0.3, -0.2 + 0.01 * k, 0.1)
        parts += [
            link(ends[1], mass, length, rng),
            urdf.joint(f"joint_{k}", kind, ends, place, axis, limit, turn),
        ]
        parent = ends[1]
    return "\n".join(parts)


def on_platform(folder: Path, extra: str, **changes: float) -> Robot:
    """Return a differential drive of general numbers with more parts on it."""
    parameters = {**SET_A, **changes}
    return rpctl.load(write(folder, platform(parameters, right_sign=-1, extra=extra)))


def chain(folder: Path, joints: int, kinds: str = "r") -> Robot:
    return on_platform(folder, arm([0.5] * joints, kinds=kinds))


def tip(folder: Path, masses: list[float]) -> Robot:
    return on_platform(folder, arm(masses))


def wide(folder: Path, track: float) -> Robot:
    return on_platform(folder, arm([3.0, 2.0]), b=0.5 * track)


def size(folder: Path, scale: float) -> Robot:
    """Return a robot ``scale`` times as long in everything, of the same density."""
    mass, inertia = scale**3, scale**5
    powers = {"m_c": mass, "m_w": mass, "I_c": inertia, "I_s": inertia, "I_d": inertia}
    grown = {key: value * powers.get(key, scale) for key, value in SET_A.items()}
    return on_platform(folder, arm([3.0 * mass, 2.0 * mass], 0.3 * scale), **grown)


def far_origin(folder: Path, distance: float) -> Robot:
    """Return a robot whose root link's frame lies ``distance`` (m) away from it, as CAD exports."""
    inner = platform(SET_A, right_sign=-1, extra=arm([3.0, 2.0]))
    place = distance, -0.7 * distance, 0
    root = urdf.link("root") + urdf.joint("mount", "fixed", ("root", "base"), place)
    return rpctl.load(write(folder, inner.replace("</robot>", f"{root}</robot>")))


def short_caster(folder: Path, trail: float) -> Robot:
    text = vehicle("casters").replace("-0.06 0.004", f"{-trail} 0.004")
    return rpctl.load(write(folder, text))


def tricycle(folder: Path, motors: str) -> Robot:
    """Return a tricycle on which only the joints ``motors`` are driven."""
    tables = "".join(
        f'[[{kind}]]\njoint = "{name}"\ndriven = {str(name in motors.split()).lower()}\n'
        for kind, names in (("wheel", "rear_left rear_right front"), ("swivel", "steer"))
        for name in names.split()
    )
    drive = write(folder, f'type = "tricycle"\n{tables}', "drive.toml")
    return rpctl.load(write(folder, vehicle("tricycle")), drive=drive)


def one_motor(folder: Path) -> Robot:
    """Return a differential drive with one driven wheel, and an arm."""
    wheels = '[[wheel]]\njoint = "left_joint"\n[[wheel]]\njoint = "right_joint"\ndriven = false\n'
    drive = write(folder, f'type = "differential"\n{wheels}', "drive.toml")
    text = platform(SET_A, right_sign=-1, extra=arm([3.0, 2.0]))
    return rpctl.load(write(folder, text), drive=drive)


Build = Callable[[Path], Robot]
NASTY: dict[str, Build] = {
    "chain of 30": partial(chain, joints=30),
    "chain of 60": partial(chain, joints=60),
    "chain of 100": partial(chain, joints=100),
    "chain of 40, R P": partial(chain, joints=40, kinds="rp"),
    "tip of 1e5 kg": partial(tip, masses=[2.0, 2.0, 2.0, 1e5]),
    "tip of 1e8 kg": partial(tip, masses=[2.0, 2.0, 2.0, 1e8]),
    "masses 1e5 to 1e-6 kg": partial(tip, masses=[1e5, 1.0, 1e-6]),
    "masses 1e-6 to 1e5 kg": partial(tip, masses=[1e-6, 1.0, 1e5]),
    "masses falling to 1e-11": partial(tip, masses=[1e3, 1e-3, 1e-8]),
    "track of 50 m": partial(wide, track=50.0),
    "track of 500 m": partial(wide, track=500.0),
    "1 mm long": partial(size, scale=1e-3),
    "30 times as long": partial(size, scale=30.0),
    "origin 100 m away": partial(far_origin, distance=100.0),
    "wheels in kg mm²": lambda folder: on_platform(
        folder, arm([3.0, 2.0]), I_s=10.0, I_d=10.0, r=0.02
    ),
    "caster with 2 mm of trail": partial(short_caster, trail=2e-3),
    "steering without a motor": partial(tricycle, motors="rear_left rear_right"),
    "front wheel drives alone": partial(tricycle, motors="front"),
    "nothing driven but the arm": partial(tricycle, motors=""),
    "one wheel of two driven": one_motor,
}


def main() -> None:
    """Print each robot, the checks that fail, and the one nearest to its limit."""
    for name, build in NASTY.items():
        with tempfile.TemporaryDirectory() as folder:
            proof = rpctl.verify(build(Path(folder)), samples=SAMPLES)
        failed = [c for c in proof.checks if not c.passed]
        listed = "; ".join(
            f"{c.name} ({c.against}) {c.residual:.1e}/{c.limit:.0e} {c.entry}" for c in failed
        )
        worst = proof.worst
        print(
            f"{name:28s} worst: {worst.name}, {worst.limit_ratio:.1e} of its limit; {len(failed)} "
            "fail"
        )
        if failed:
            print(f"{'':28s} FAILS {listed}")


if __name__ == "__main__":
    main()
