"""Robots on every kind of wheel, written for tests: general numbers, an arm joint, odd signs."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin

from tests import urdf

CASTERS = [(0.4, 0.2, 0.06), (0.4, -0.2, 0.05), (-0.3, 0, 0.07)]  # place x, y and trail, m
LIMIT = urdf.limit(-1.2, 1.2, 40, 6)


@dataclass
class Parts:
    """Links and joints under construction."""

    xml: list[str]

    def link(self, name: str, mass: float, shape: str = "", com: str = "0 0 0") -> None:
        i = 0.02 * mass
        moments, products = (i, 1.2 * i, 0.9 * i), (0.1 * i, 0.0, -0.05 * i)
        inertia = urdf.inertial(mass, moments, products, com, "0.2 -0.1 0.3")
        self.xml.append(urdf.link(name, inertia, shape))

    def joint(
        self, name: str, kind: str, ends: tuple[str, str], xyz: str, axis: str, more: str = ""
    ) -> None:
        limit = LIMIT if kind == "revolute" else ""
        self.xml.append(urdf.joint(name, kind, ends, xyz, axis, limit + more))

    def text(self, name: str) -> str:
        """Return the URDF, all on its first line, as some programs write it."""
        return urdf.robot(name, *self.xml).replace("\n", "")

    def wheel(
        self, name: str, parent: str, xyz: str, axis: str = "0 1 0", r: float = 0.1, turn: float = 0
    ) -> None:
        shape = f'cylinder radius="{r}" length="0.04"'
        self.link(f"{name}_link", 1.0, urdf.shape(shape, rpy=(pi / 2, 0, turn)))
        self.joint(name, "continuous", (parent, f"{name}_link"), xyz, axis)

    def swivel(self, name: str, xyz: str, kind: str, axis: str = "0 0 1", more: str = "") -> None:
        self.link(f"{name}_fork", 0.6, com="0.01 -0.02 0.03")
        self.joint(name, kind, ("base", f"{name}_fork"), xyz, axis, more)


def start() -> Parts:
    """Return a base with one arm joint; the ground is at z = 0."""
    parts = Parts([])
    parts.link("base", 25.0, com="0.07 -0.03 0.25")
    parts.link("arm", 3.0, com="0.2 0.1 0.1")
    parts.joint("arm_joint", "revolute", ("base", "arm"), "0.1 0.05 0.5", "0.36 0.48 0.8")
    return parts


def rear_axle(parts: Parts, x: float = 0.0, b: float = 0.3) -> None:
    parts.wheel("rear_left", "base", f"{x} {b} 0.1")
    parts.wheel("rear_right", "base", f"{x} {-b} 0.1", "0 -1 0")


def caster(parts: Parts, name: str, x: float, y: float, trail: float, twin: bool) -> None:
    parts.swivel(name, f"{x} {y} 0.12", "continuous", "0 0 -1")
    sides = (0.02, -0.02) if twin else (0.004,)
    for side in sides:
        roller = f"{name}_roller{'_' if twin else ''}{'lr'[side < 0] if twin else ''}"
        parts.wheel(roller, f"{name}_fork", f"{-trail} {side} -0.07", r=0.05)


def trailer(parts: Parts, name: str, puller: str, at: str, length: float, axis: str) -> None:
    """A trailer whose axle lies ``length`` m behind its hitch and a little to one side."""
    parts.link(f"{name}_body", 6.0, com=f"{-0.8 * length} 0.02 0.1")
    limit, ends = urdf.limit(-1.4, 1.4, 0, 6), (puller, f"{name}_body")
    parts.xml.append(urdf.joint(f"{name}_hitch", "revolute", ends, at, axis, limit))
    parts.wheel(f"{name}_left", f"{name}_body", f"{-length} 0.23 -0.1", r=0.1)
    parts.wheel(f"{name}_right", f"{name}_body", f"{-length} -0.21 -0.1", "0 -1 0", r=0.1)


def vehicle(kind: str) -> str:
    """Return the URDF of a robot of a kind; see ``KINDS``."""
    parts = start()
    if kind == "casters":
        rear_axle(parts)
        for k, (x, y, trail) in enumerate(CASTERS):
            caster(parts, f"caster_{k}", x, y, trail, twin=k == 1)
    elif kind == "powered":
        for k, (x, y, trail) in enumerate(CASTERS):
            caster(parts, f"caster_{k}", x, y, trail, twin=k == 1)
        parts.xml.append(urdf.actuated("caster_0", "caster_0_roller", "caster_1_roller_l"))
        parts.xml.append(urdf.actuated("caster_1_roller_r", "caster_2_roller"))
    elif kind in ("car-like", "parallel"):
        rear_axle(parts)
        mimic = '<mimic joint="steer_left" multiplier="-0.9"/>' if kind == "parallel" else ""
        parts.swivel("steer_left", "0.7 0.25 0.1", "revolute")
        parts.wheel("front_left", "steer_left_fork", "0 0.05 0")
        parts.swivel("steer_right", "0.7 -0.25 0.1", "revolute", "0 0 -1", mimic)
        parts.wheel("front_right", "steer_right_fork", "0 -0.05 0", "0 -1 0")
    elif kind == "tricycle":
        rear_axle(parts, x=-0.1)
        parts.swivel("steer", "0.6 0 0.3", "revolute")
        parts.wheel("front", "steer_fork", "0.03 0.01 -0.2")
    elif kind == "trailers":  # a car that pulls two, the last of which has a caster
        rear_axle(parts)
        parts.swivel("steer", "0.7 0.02 0.3", "revolute")
        parts.wheel("front", "steer_fork", "0 0.01 -0.2")
        trailer(parts, "first", "base", "-0.3 0.03 0.2", 0.7, "0 0 -1")
        trailer(parts, "second", "first_body", "-0.9 -0.02 0", 0.5, "0 0 1")
        parts.link("caster_fork", 0.6, com="0.01 -0.02 0.03")
        ends = ("second_body", "caster_fork")
        parts.joint("caster", "continuous", ends, "-0.1 0.05 -0.08", "0 0 1")
        parts.wheel("caster_roller", "caster_fork", "-0.06 0 -0.07", r=0.05)
    elif kind == "articulated":
        rear_axle(parts)
        parts.link("rear_body", 12.0, com="-0.4 0.02 0.2")
        parts.joint("waist", "revolute", ("base", "rear_body"), "-0.5 0 0.3", "0 0 1")
        parts.wheel("back_left", "rear_body", "-0.45 0.3 -0.2")
        parts.wheel("back_right", "rear_body", "-0.45 -0.3 -0.2", "0 -1 0")
    elif kind == "bicycle":
        parts.wheel("rear", "base", "0 0 0.1")
        parts.swivel("steer", "0.8 0 0.3", "revolute", "0 0 -1")
        parts.wheel("front", "steer_fork", "0 0 -0.2")
    elif kind in ("steered", "twin"):
        places = [("fl", 0.4, 0.3), ("fr", 0.4, -0.3), ("rl", -0.35, 0.3), ("rr", -0.35, -0.3)]
        for k, (name, x, y) in enumerate(places):
            parts.swivel(f"{name}_steer", f"{x} {y} 0.1", "continuous", f"0 0 {(1, -1)[k % 2]}")
            if kind == "steered":
                parts.wheel(f"{name}_wheel", f"{name}_steer_fork", "0 0.02 0", "0 -1 0")
            else:
                parts.wheel(f"{name}_l_wheel", f"{name}_steer_fork", "0 0.05 0")
                parts.wheel(f"{name}_r_wheel", f"{name}_steer_fork", "0 -0.05 0")
    elif kind == "omni":
        for k, turn in enumerate((0.0, 2 * pi / 3, -2 * pi / 3)):
            x, y = 0.3 * cos(turn), 0.3 * sin(turn)
            axis = f"{cos(turn)!r} {sin(turn)!r} 0"
            parts.wheel(f"omni_{k}", "base", f"{x!r} {y!r} 0.1", axis, turn=turn + pi / 2)
    return parts.text(kind)


KINDS = {  # type of the drive, quasi-velocities of the base
    "casters": ("differential", ("v", "omega")),
    "car-like": ("car-like", ("v", "steer_left")),
    "parallel": ("car-like", ("v", "steer_left")),
    "tricycle": ("tricycle", ("v", "steer")),
    "bicycle": ("bicycle", ("v", "steer")),
    "steered": ("steered", ("v", "fl_steer", "rl_steer")),
    "twin": ("steered", ("v", "fl_steer", "rl_steer")),
    "omni": ("omni", ("vx", "vy", "omega")),
    "powered": ("powered-casters", ("vx", "vy", "omega")),
    "trailers": ("tricycle", ("v", "steer")),
    "articulated": ("articulated", ("v", "waist")),
}
