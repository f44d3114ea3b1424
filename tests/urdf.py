"""URDFs for tests, written part by part; what is said of a part stands on one line."""

from __future__ import annotations

from collections.abc import Iterable

Numbers = str | Iterable[float]
ROUND = "1.5707963267948966 0 0"  # roll, pitch, yaw that turn a cylinder's z axis to y
DIAGONAL = (0.0, 0.0, 0.0)  # products of inertia


def robot(name: str, *parts: str) -> str:
    """Return a URDF of links and joints."""
    return "\n".join([f'<robot name="{name}">', *parts, "</robot>\n"])


def link(name: str, *inside: str) -> str:
    """Return a link; ``inside`` are its inertial, its shapes, or any XML."""
    return "\n".join([f'  <link name="{name}">', *filter(None, inside), "  </link>"])


def inertial(
    mass: float,
    moments: Iterable[float],
    products: Iterable[float] = DIAGONAL,
    xyz: Numbers = "",
    rpy: Numbers = "",
) -> str:
    """Return a link's inertia.

    Args:
        mass: kg.
        moments: Ixx, Iyy, Izz, kg m².
        products: Ixy, Ixz, Iyz, kg m².
        xyz: Centre of mass in the link's frame, m.
        rpy: Of the axes of inertia, rad.
    """
    (xx, yy, zz), (xy, xz, yz) = moments, products
    return f"""    <inertial>
      {origin(xyz, rpy)}<mass value="{mass}"/>
      <inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/>
    </inertial>"""


def shape(geometry: str, role: str = "collision", xyz: Numbers = "", rpy: Numbers = "") -> str:
    """Return a shape of a link.

    Args:
        geometry: Its element without the brackets, such as ``sphere radius="0.1"``.
        role: ``collision`` or ``visual``.
        xyz: Its origin in the link's frame, m.
        rpy: Of its axes, rad.
    """
    return f"    <{role}>{origin(xyz, rpy)}<geometry><{geometry}/></geometry></{role}>"


def joint(
    name: str,
    kind: str,
    ends: tuple[str, str],
    xyz: Numbers = "",
    axis: Numbers = "",
    more: str = "",
    rpy: Numbers = "",
) -> str:
    """Return a joint.

    Args:
        name: Its name.
        kind: ``continuous``, ``revolute``, ``prismatic`` or ``fixed``.
        ends: Parent and child.
        xyz: Its origin in the parent's frame, m.
        axis: In its own frame.
        more: XML such as its limit.
        rpy: Of its frame, rad.
    """
    turning = f'<axis xyz="{text}"/>' if (text := _text(axis)) else ""
    return f"""  <joint name="{name}" type="{kind}">
    <parent link="{ends[0]}"/><child link="{ends[1]}"/>
    {origin(xyz, rpy)}{turning}{more}</joint>"""


def actuated(*joints: str) -> str:
    """Return one transmission for each joint: it has a motor."""
    return "\n".join(
        f'  <transmission name="{name}_motor"><joint name="{name}"/></transmission>'
        for name in joints
    )


def limit(lower: float, upper: float, effort: float, velocity: float) -> str:
    """Return a joint's limits: rad or m, N m or N, rad/s or m/s."""
    return f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/>'


def origin(xyz: Numbers, rpy: Numbers = "") -> str:
    """Return where a part lies (m, rad); nothing where it has its parent's frame."""
    given = {"xyz": _text(xyz), "rpy": _text(rpy)}
    written = "".join(f' {key}="{text}"' for key, text in given.items() if text)
    return f"<origin{written}/>" if written else ""


def _text(values: Numbers) -> str:
    """Return numbers as they are written, each double exactly."""
    return values if isinstance(values, str) else " ".join(map(str, values))
