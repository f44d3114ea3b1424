"""Whipple's bicycle: its URDF, and its linear equations as published.

J. P. Meijaard, J. M. Papadopoulos, A. Ruina, A. L. Schwab, "Linearized dynamics equations for the
balance and steer of a bicycle: a benchmark and review", Proc. R. Soc. A 463, 2007. There z points
down; the lean is to the right, and so is the steering.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rpctl.arrays import Array

GRAVITY = 9.81

BENCHMARK = {
    "w": 1.02, "c": 0.08, "lam": math.pi / 10.0, "rR": 0.3, "mR": 2.0, "IRxx": 0.0603,
    "IRyy": 0.12, "xB": 0.3, "zB": -0.9, "mB": 85.0, "IBxx": 9.2, "IByy": 11.0, "IBzz": 2.8,
    "IBxz": 2.4, "xH": 0.9, "zH": -0.7, "mH": 4.0, "IHxx": 0.05892, "IHyy": 0.06,
    "IHzz": 0.00708, "IHxz": -0.00756, "rF": 0.35, "mF": 3.0, "IFxx": 0.1405, "IFyy": 0.28,
}  # fmt: skip


class LinearBicycle(NamedTuple):
    """M q̈ + v C1 q̇ + (g K0 + v² K2) q = 0 of q = (lean, steering)."""

    M: Array
    C1: Array
    K0: Array
    K2: Array


PUBLISHED = LinearBicycle(  # Table of the benchmark's entries
    np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]]),
    np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]]),
    np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]]),
    np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]]),
)


def linear_equations(p: dict[str, float]) -> LinearBicycle:
    """Return the linear equations of a bicycle; Appendix A of the paper."""
    mT = p["mR"] + p["mB"] + p["mH"] + p["mF"]
    xT = (p["xB"] * p["mB"] + p["xH"] * p["mH"] + p["w"] * p["mF"]) / mT
    zT = (-p["rR"] * p["mR"] + p["zB"] * p["mB"] + p["zH"] * p["mH"] - p["rF"] * p["mF"]) / mT
    ITxx = p["IRxx"] + p["IBxx"] + p["IHxx"] + p["IFxx"] + p["mR"] * p["rR"] ** 2
    ITxx += p["mB"] * p["zB"] ** 2 + p["mH"] * p["zH"] ** 2 + p["mF"] * p["rF"] ** 2
    ITxz = p["IBxz"] + p["IHxz"] - p["mB"] * p["xB"] * p["zB"] - p["mH"] * p["xH"] * p["zH"]
    ITxz += p["mF"] * p["w"] * p["rF"]
    ITzz = p["IRxx"] + p["IBzz"] + p["IHzz"] + p["IFxx"]
    ITzz += p["mB"] * p["xB"] ** 2 + p["mH"] * p["xH"] ** 2 + p["mF"] * p["w"] ** 2
    mA = p["mH"] + p["mF"]
    xA = (p["xH"] * p["mH"] + p["w"] * p["mF"]) / mA
    zA = (p["zH"] * p["mH"] - p["rF"] * p["mF"]) / mA
    IAxx = p["IHxx"] + p["IFxx"] + p["mH"] * (p["zH"] - zA) ** 2 + p["mF"] * (p["rF"] + zA) ** 2
    IAxz = p["IHxz"] - p["mH"] * (p["xH"] - xA) * (p["zH"] - zA)
    IAxz += p["mF"] * (p["w"] - xA) * (p["rF"] + zA)
    IAzz = p["IHzz"] + p["IFxx"] + p["mH"] * (p["xH"] - xA) ** 2 + p["mF"] * (p["w"] - xA) ** 2
    sin, cos, w, c = math.sin(p["lam"]), math.cos(p["lam"]), p["w"], p["c"]
    uA = (xA - w - c) * cos - zA * sin
    IAll = mA * uA**2 + IAxx * sin**2 + 2.0 * IAxz * sin * cos + IAzz * cos**2
    IAlx = -mA * uA * zA + IAxx * sin + IAxz * cos
    IAlz = mA * uA * xA + IAxz * sin + IAzz * cos
    mu = c / w * cos
    SR, SF = p["IRyy"] / p["rR"], p["IFyy"] / p["rF"]
    ST = SR + SF
    SA = mA * uA + mu * mT * xT
    M = [[ITxx, IAlx + mu * ITxz], [0.0, IAll + 2.0 * mu * IAlz + mu**2 * ITzz]]
    M[1][0] = M[0][1]
    K0 = [[mT * zT, -SA], [-SA, -SA * sin]]
    K2 = [[0.0, (ST - mT * zT) / w * cos], [0.0, (SA + SF * sin) / w * cos]]
    C1 = [
        [0.0, mu * ST + SF * cos + ITxz / w * cos - mu * mT * zT],
        [-(mu * ST + SF * cos), IAlz / w * cos + mu * (SA + ITzz / w * cos)],
    ]
    return LinearBicycle(*(np.array(each) for each in (M, C1, K0, K2)))


def urdf(p: dict[str, float], name: str = "whipple") -> str:
    """Return a bicycle as a URDF: x forward, z up, the root link's origin at the rear contact."""
    sin, cos = math.sin(p["lam"]), math.cos(p["lam"])
    ahead = p["w"] + p["c"]  # where the steering axis meets the ground

    def link(name: str, mass: float, at: tuple[float, float], xx: float, yy: float, zz: float,
             xz: float = 0.0, radius: float = 0.0) -> str:  # fmt: skip
        shape = (
            '<collision><origin rpy="1.5707963267948966 0 0"/><geometry>'
            f'<cylinder radius="{radius!r}" length="0.02"/></geometry></collision>'
        )
        return (
            f'<link name="{name}"><inertial><origin xyz="{at[0]!r} 0 {at[1]!r}"/>'
            f'<mass value="{mass!r}"/><inertia ixx="{xx!r}" iyy="{yy!r}" izz="{zz!r}" ixy="0" '
            f'iyz="0" ixz="{xz!r}"/></inertial>{shape if radius else ""}</link>'
        )

    def joint(name: str, kind: str, parent: str, child: str, at: tuple[float, float],
              axis: str, limit: str) -> str:  # fmt: skip
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{at[0]!r} 0 {at[1]!r}"/><axis xyz="{axis}"/>{limit}</joint>'
        )

    return "".join((
        f'<robot name="{name}">',
        link("frame", p["mB"], (p["xB"], -p["zB"]), p["IBxx"], p["IByy"], p["IBzz"], -p["IBxz"]),
        link("rear", p["mR"], (0.0, 0.0), p["IRxx"], p["IRyy"], p["IRxx"], radius=p["rR"]),
        link("fork", p["mH"], (p["xH"] - ahead, -p["zH"]), p["IHxx"], p["IHyy"], p["IHzz"],
             -p["IHxz"]),
        link("front", p["mF"], (0.0, 0.0), p["IFxx"], p["IFyy"], p["IFxx"], radius=p["rF"]),
        joint("rear_wheel", "continuous", "frame", "rear", (0.0, p["rR"]), "0 1 0",
              '<limit effort="100" velocity="50"/>'),
        joint("steering", "revolute", "frame", "fork", (ahead, 0.0), f"{sin!r} 0 {-cos!r}",
              '<limit lower="-1.2" upper="1.2" effort="20" velocity="10"/>'),
        joint("front_wheel", "continuous", "fork", "front", (-p["c"], p["rF"]), "0 1 0",
              '<limit effort="0" velocity="50"/>'),
        "</robot>",
    ))  # fmt: skip
