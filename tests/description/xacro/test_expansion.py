"""``.xacro`` files: expanded as xacro does, within the folders they may use, in bounded time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import rpctl
from rpctl.cli.app import app
from rpctl.description.xacro.expansion import expand
from rpctl.description.xacro.messages import ExpansionError
from rpctl.errors import DescriptionError
from tests.description.corpus import BASE

pytest.importorskip("xacro")

ROOT = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n{}\n</robot>'
WHEEL = BASE[BASE.index('  <link name="left_wheel">') : BASE.index('  <link name="right_wheel">')]
JOINT = BASE[BASE.index('  <joint name="left_joint"') : BASE.index('  <joint name="right_joint"')]
RIGHT = {"left": "right", '"0 0.3': '"0 -0.3'}
PARTS = ROOT.format(
    '<xacro:property name="r" value="0.15"/><xacro:macro name="wheel" params="side y">'
    + WHEEL.replace("left", "${side}").replace('"0.15"', '"${r}"').replace(
        "1.5707963267948966", "${pi/2}")
    + JOINT.replace("left", "${side}").replace('"0 0.3 0.15"', '"0 ${y} ${r}"')
    + "</xacro:macro>"
)  # fmt: skip


def mirrored(text: str) -> str:
    for left, right in RIGHT.items():
        text = text.replace(left, right)
    return text


def folded() -> str:
    """Return the base file with a macro for its wheels, taken from another package."""
    text = BASE.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    text = text.replace(
        "  <link ", '  <xacro:include filename="$(find parts)/w.xacro"/>\n  <link ', 1
    )
    for side, y, change in (("left", "0.3", str), ("right", "-0.3", mirrored)):
        assert change(WHEEL) in text
        text = text.replace(change(WHEEL), f'<xacro:wheel side="{side}" y="{y}"/>')
        text = text.replace(change(JOINT), "")
    return text


def write(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def small(folder: Path, content: str) -> Path:
    return write(folder / "ws" / "bot" / "bot.urdf.xacro", ROOT.format(content))


def test_the_robot_is_that_of_the_plain_file(tmp_path: Path) -> None:
    path = write(tmp_path / "bot" / "bot.urdf.xacro", folded())
    write(tmp_path / "far" / "parts" / "w.xacro", PARTS)
    with pytest.raises(ExpansionError, match=r"a package was not found: parts; .*--package-dir"):
        rpctl.load(path)
    robot = rpctl.load(path, package_dirs=[tmp_path / "far"])
    plain = rpctl.load(write(tmp_path / "plain.urdf", BASE))
    q = robot.configuration(theta=0.3, joints={"shoulder": 0.4, "slide": 0.05})
    nu = np.array([0.3, -0.2, 0.1, 0.4])
    assert robot.quasi_velocities == plain.quasi_velocities
    ours, theirs = rpctl.ReducedDynamics(robot), rpctl.ReducedDynamics(plain)
    np.testing.assert_allclose(ours.inertia(q), theirs.inertia(q), rtol=1e-13)
    np.testing.assert_allclose(ours.bias(q, nu), theirs.bias(q, nu), rtol=1e-12, atol=1e-14)
    (finding,) = robot.findings
    assert finding.severity == "info"
    assert finding.message.startswith("lines are those of the expanded text; `rpctl expand")


def test_lines_are_those_of_what_expand_prints(tmp_path: Path) -> None:
    body = BASE[BASE.index("  <link") : BASE.index("</robot>")].replace('"30"', '"${m}"')
    path = small(tmp_path, f'<xacro:property name="m" value="-3"/>\n\n\n{body}')
    with pytest.raises(DescriptionError) as caught:
        rpctl.load(path)
    first, last = str(caught.value).splitlines()
    printed = CliRunner().invoke(app, ["expand", str(path)])
    assert printed.exit_code == 0
    line = printed.stdout[: printed.stdout.index('<mass value="-3"/>')].count("\n") + 1
    assert first == f'{path}:{line}: error: mass -3 of link "base" is negative; give its kg'
    assert last == f"{path}: info: lines are those of the expanded text; `rpctl expand {path}` " \
        "prints it"  # fmt: skip
    write(tmp_path / "again.urdf", printed.stdout)
    with pytest.raises(DescriptionError, match=f"again.urdf:{line}: error: mass -3"):
        rpctl.load(tmp_path / "again.urdf")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("${1/0}", "division by zero when evaluating expression '1/0'"),
        ("${open('/etc/passwd')}", "name 'open' is not defined"),
        ("${().__class__}", "Use of invalid name"),
        ("$(arg size)", 'argument "size" has no value; add size:=VALUE'),
        ('<xacro:include filename="$(find nobody)/a"/>', "was not found: nobody; declare"),
        ("$(find ../..)", '"../.." is not the name of a package'),
        ("<xacro:leg/>", "unknown macro name: xacro:leg"),
        ('<xacro:macro name="m"><a b="${u}"/></xacro:macro><xacro:m/>', '(in macro "m")'),
        ('<xacro:include filename="none.xacro"/>', "No such file or directory"),
        ('<xacro:include filename="/etc/passwd"/>', "refused: it lies outside the folders"),
        ('<xacro:include filename="../../out.xacro"/>', "refused: it lies outside the folders"),
        ('<xacro:include filename="link.xacro"/>', "refused: it lies outside the folders"),
        ('<xacro:include filename="bot.urdf.xacro"/>', "maximum recursion depth exceeded"),
        ('${xacro.load_yaml("/etc/hostname")}', "refused: it lies outside the folders"),
        ('${xacro.fatal("no such size")}', "no such size"),
        ("${'a' * 10**11}", "of memory; to allow it, set RPCTL_MAX_XACRO_MEMORY"),
        ("${[0] * 10**9}", "of memory; to allow it, set RPCTL_MAX_XACRO_MEMORY"),
        pytest.param(
            "${9**9**9}", "takes over 3 s; to allow it, set RPCTL_MAX_XACRO_SECONDS",
            marks=pytest.mark.slow,  # it waits
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_expanded_is_told(
    content: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = small(tmp_path, content)
    write(tmp_path / "out.xacro", ROOT.format(""))
    (path.parent / "link.xacro").symlink_to(tmp_path / "out.xacro")
    monkeypatch.setenv("RPCTL_MAX_XACRO_SECONDS", "3")
    with pytest.raises(ExpansionError) as caught:
        rpctl.load(path)
    message = str(caught.value)
    assert "error: " in message
    assert expected in message
    assert message.replace("\n", "").isprintable()
    assert message.startswith(str(path.parent))


@pytest.mark.parametrize("left", ["<front_steer side='1'/>", "<insert_block name='origin'/>"])
def test_a_macro_without_its_prefix_is_told_not_dropped(tmp_path: Path, left: str) -> None:
    """What a URDF has of its own may be called like a macro."""
    path = tmp_path / "robot.urdf.xacro"
    macro = '<xacro:macro name="front_steer" params="side"><link name="steer"/></xacro:macro>'
    macro += '<xacro:macro name="inertial" params="m"><link name="other"/></xacro:macro>'
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
    body = '<link name="base"><inertial><mass value="1"/></inertial></link>\n'
    path.write_text(f"{head}{macro}{body}{left}</robot>")
    tag = left[1:].partition(" ")[0]
    with pytest.raises(ExpansionError, match=rf"xacro:3: error: <{tag}> .* write <xacro:{tag} …>"):
        expand(path)
    unused = f'<xacro:macro name="unused" params="">{left}</xacro:macro>'
    path.write_text(f"{head}{macro}{unused}{body}</robot>")
    assert "inertial" in expand(path).text


def test_macros_alone_come_with_the_file_that_calls_them(tmp_path: Path) -> None:
    """What is told to write beside it, its gaps filled, is the robot."""
    wheels = WHEEL + JOINT + mirrored(WHEEL) + mirrored(JOINT)
    rest = BASE[BASE.index("<link") : BASE.index("</robot>")].replace(wheels, "")
    macro = f"""<xacro:macro name="helper" params="a"/>
        <xacro:macro name="bot" params="side:=left y='0.3' prefix *cargo">{rest}
        <xacro:insert_block name="cargo"/></xacro:macro>"""
    path = small(tmp_path, macro)
    with pytest.raises(ExpansionError) as caught:
        rpctl.load(path)
    told, _, wrapper = str(caught.value).partition("load it:\n")
    line = 2 + macro[: macro.index('"bot"')].count("\n")
    assert told.startswith(f"{path}:{line}: error: it defines macros (helper, bot) but calls none")
    assert wrapper.count("...") == 2
    filled = wrapper.replace('prefix="..."', 'prefix="p"').replace("<cargo>...", "<cargo>")
    robot = rpctl.load(write(path.with_name("mine.xacro"), filled))
    assert robot.quasi_velocities == rpctl.load(write(tmp_path / "b.urdf", BASE)).quasi_velocities
