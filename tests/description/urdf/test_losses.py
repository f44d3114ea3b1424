"""What a file says of damping, friction and rotors, and what is wrong with it."""

from __future__ import annotations

from pathlib import Path

import pytest

import rpctl
from rpctl.description.urdf.reader import parse
from rpctl.errors import UnknownNameError
from tests.urdf import inertial, joint, limit, link, robot

LIMIT = limit(-1, 1, 20, 2)
DRAKE = '<drake:rotor_inertia value="1e-4"/>'
MASS = inertial(1.0, (0.1, 0.1, 0.1))


def text(loss: str, kind: str = "revolute", more: str = "") -> str:
    """Return a fixed base with one joint, whose losses stand on line 11."""
    return robot(
        "one", link("base", MASS), link("arm", MASS),
        joint("hinge", kind, ("base", "arm"), axis="0 0 1", more=f"{LIMIT}\n{loss}"), more,
    )  # fmt: skip


def rotor(inside: str, joints: tuple[str, ...] = ("hinge",)) -> str:
    named = "".join(f'<joint name="{name}"/>' for name in joints)
    return f'<transmission name="t">{named}<actuator name="m">{inside}</actuator></transmission>'


@pytest.mark.parametrize(
    ("loss", "kind", "message", "kept"),
    [
        ('<dynamics damping="-2"/>', "revolute", "damping -2 of joint \"hinge\" is negative", 0.0),
        ('<dynamics friction="-2"/>', "revolute", "friction -2 of joint \"hinge\" is", 0.0),
        ('<dynamics friction="21"/>', "revolute", "it cannot start; give both in N m", 21.0),
        ('<dynamics friction="21"/>', "prismatic", "it cannot start; give both in N", 21.0),
        ('<dynamics damping="10.1"/>', "revolute", "velocity limit 2; give it in N m s/rad", 10.1),
        ('<dynamics damping="10.1"/>', "prismatic", "velocity limit 2; give it in N s/m", 10.1),
    ],
)  # fmt: skip
def test_doubtful_losses_are_told(loss: str, kind: str, message: str, kept: float) -> None:
    described = parse(Path("robot.urdf"), text(loss, kind).encode())
    (finding,) = described.findings
    assert (finding.severity, message in finding.message) == ("warning", True)
    line = text(loss, kind).splitlines().index(loss + "</joint>") + 1
    assert finding.line == line
    assert max(described.joints[0].damping, described.joints[0].friction) == kept


@pytest.mark.parametrize(
    ("inside", "inertia"),
    [
        (f'{DRAKE}<drake:gear_ratio value="-50"/>', 0.25),
        (
            '<drake:rotor_inertia value="1e-4"/><mechanicalReduction> 20 </mechanicalReduction>',
            0.04,
        ),
        ('<rotor_inertia value="1e-4"/>', 1e-4),
        ("<mechanicalReduction>20</mechanicalReduction>", None),
    ],
)
@pytest.mark.parametrize("declared", [False, True])
def test_rotors_of_transmissions(
    inside: str, inertia: float | None, declared: bool, tmp_path: Path
) -> None:
    """I n², whatever the sign of the ratio, and whether the prefix is declared or not."""
    written = text("", more=rotor(inside))
    if declared:
        written = written.replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ')
    described = parse(Path("robot.urdf"), written.encode())
    assert described.rotors == ({} if inertia is None else {"hinge": pytest.approx(inertia)})
    path = tmp_path / "robot.urdf"
    path.write_text(written)
    if inertia is None:
        with pytest.raises(rpctl.RpctlError, match="gives the inertia of a rotor"):
            rpctl.load(path, drive="fixed", armature=True)
        return
    found = rpctl.load(path, drive="fixed", armature=True)
    M = rpctl.ReducedDynamics(found).inertia(found.configuration())
    assert M[0, 0] == pytest.approx(0.1 + inertia)
    assert not rpctl.load(path, drive="fixed").armature.any()


def test_armature_by_pattern(tmp_path: Path) -> None:
    """What the user says counts before what the file says."""
    path = tmp_path / "robot.urdf"
    path.write_text(text("", more=rotor('<rotor_inertia value="1e-4"/>')))
    found = rpctl.load(path, drive="fixed", armature={"*": 0.5, "hin*": 0.3})
    assert found.armature.max() == 0.3
    assert rpctl.verify(found, samples=1, engines=()).passed
    with pytest.raises(UnknownNameError, match="wrist"):
        rpctl.load(path, drive="fixed", armature={"wrist*": 0.3})
    for wrong in (-1.0, float("nan")):
        with pytest.raises(rpctl.RpctlError, match="the armature of hinge"):
            rpctl.load(path, drive="fixed", armature={"hinge": wrong})
