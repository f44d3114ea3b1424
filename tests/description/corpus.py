"""Broken and odd URDFs, each with what must be said of it; ¶ marks the line to blame."""

# A table: one file a line, however long.
# ruff: noqa: E501
# fmt: off
from __future__ import annotations

from dataclasses import dataclass

MARK = "¶"
BASE = """<?xml version="1.0" encoding="UTF-8"?>
<robot name="r">
  <material name="red"><color rgba="1 0 0 1"/></material>
  <link name="base">
    <inertial>
      <origin xyz="0.1 0 0.2" rpy="0 0 0"/>
      <mass value="30"/>
      <inertia ixx="1.5" ixy="0" ixz="0" iyy="1.6" iyz="0" izz="1.7"/>
    </inertial>
    <visual>
      <geometry><box size="0.5 0.4 0.2"/></geometry>
      <material name="red"/>
    </visual>
  </link>
  <link name="left_wheel">
    <inertial><mass value="1"/>
      <inertia ixx="0.0025" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.0025"/></inertial>
    <collision><origin rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="0.15" length="0.04"/></geometry></collision>
  </link>
  <link name="right_wheel">
    <inertial><mass value="1"/>
      <inertia ixx="0.0025" ixy="0" ixz="0" iyy="0.005" iyz="0" izz="0.0025"/></inertial>
    <collision><origin rpy="1.5707963267948966 0 0"/>
      <geometry><cylinder radius="0.15" length="0.04"/></geometry></collision>
  </link>
  <link name="arm">
    <inertial><mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial>
  </link>
  <link name="blade">
    <inertial><mass value="0.1"/>
      <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
  </link>
  <joint name="left_joint" type="continuous">
    <parent link="base"/><child link="left_wheel"/>
    <origin xyz="0 0.3 0.15"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="right_joint" type="continuous">
    <parent link="base"/><child link="right_wheel"/>
    <origin xyz="0 -0.3 0.15"/><axis xyz="0 1 0"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="arm"/>
    <origin xyz="0.2 0 0.4"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="9" velocity="3"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="arm"/>
    <child link="blade"/>
    <origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.1" effort="5" velocity="1"/>
  </joint>
</robot>
"""


@dataclass(frozen=True)
class UrdfCase:
    """A file, and a finding that reading it must give.

    Attributes:
        name: What is wrong.
        severity: Of the finding; an ``"error"`` raises.
        message: Part of its message.
        data: The file.
        line: Where the finding must be, or None for the file as a whole.
    """

    name: str
    severity: str
    message: str
    data: bytes
    line: int | None


CASES: list[UrdfCase] = []


def add_case(name: str, severity: str, message: str, text: str, codec: str = "utf-8") -> None:
    """Add a case whose text has at most one mark."""
    before, mark, _ = text.partition(MARK)
    line = before.count("\n") + 1 if mark else None
    CASES.append(UrdfCase(name, severity, message, text.replace(MARK, "").encode(codec), line))


def add_change(name: str, severity: str, message: str, before: str, after: str) -> None:
    """Add the base file with one replacement, which starts the line to blame if not marked."""
    assert before in BASE, before
    text = BASE.replace(before, after if MARK in after else MARK + after, 1)
    add_case(name, severity, message, text)


def add_error(name: str, message: str, before: str, after: str) -> None:
    """Add an error."""
    add_change(name, "error", message, before, after)


def add_warning(name: str, message: str, before: str, after: str) -> None:
    """Add a warning."""
    add_change(name, "warning", message, before, after)


def without(text: str) -> str:
    """Return the base file with a mark where a text was."""
    assert text in BASE
    return BASE.replace(text, MARK, 1)


# Numbers.
for label, value, message in (
    ("word", "heavy", "is not a number; write digits"),
    ("empty", "", "has 0 numbers; give 1"),
    ("nan", "nan", "is not finite"),
    ("inf", "-Infinity", "is not finite"),
    ("overflow", "1e999", "is not finite"),
    ("comma", "1,5", 'decimal comma; write "1.5"'),
    ("unit", "1.5kg", 'leave out the unit "kg"; write "1.5"'),
    ("unit after a blank", "1.5 kg", 'leave out the unit "kg"; write "1.5"'),
    ("xacro value", "${m}", "unexpanded xacro"),
    ("hexadecimal", "0x10", "is not a number"),
    ("underscore", "1_000", "is not a number"),
    ("full-width digit", "１", "is not a number"),
    ("two", "1 2", "has 2 numbers; give 1"),
    ("absurd", "1e12", "is too large; URDF uses metres, kilograms"),
    ("too many digits", "1" * 100, "is not a number"),
    ("negative", "-3", 'mass -3 of link "base" is negative'),
):
    add_error(f"mass: {label}", message, '<mass value="30"/>', f'<mass value="{value}"/>')
for error in (
    ("commas in a vector", "separate numbers by blanks", '<axis xyz="0 0 1"/>', '<axis xyz="0,0,1"/>'),
    ("semicolons", "separate numbers by blanks", '<axis xyz="0 0 1"/>', '<axis xyz="0; 0; 1"/>'),
    ("no value", '<mass> has no attribute "value"', '<mass value="30"/>', "<mass/>"),
    ("angle: degrees sign", "leave out the unit", 'rpy="0 0 0"', 'rpy="0 0 90°"'),
    ("quaternion", "write the rotation as rpy", '<origin xyz="0.2 0 0.4"/>', '<origin quat_xyzw="0 0 0 1"/>'),
):
    add_error(*error)
for warning in (
    ("grams", "is it in grams?", '<mass value="30"/>', '<mass value="30000"/>'),
    ("angle in degrees", "is it in degrees?", '<origin xyz="0.2 0 0.4"/>', '<origin rpy="0 0 90"/>'),
    ("length in mm", "is it in mm?", '<origin xyz="0.2 0 0.4"/>', '<origin xyz="200 0 400"/>'),
):
    add_warning(*warning)

# Inertias.
INERTIA = '<inertia ixx="1.5" ixy="0" ixz="0" iyy="1.6" iyz="0" izz="1.7"/>'
for error in (
    ("no mass", "has no <mass>; add it", '<inertial>\n      <origin xyz="0.1 0 0.2" rpy="0 0 0"/>\n      <mass value="30"/>', "<inertial>"),
    ("no ixy", '<inertia> has no attribute "ixy"', INERTIA, INERTIA.replace('ixy="0" ', "")),
):
    add_error(*error)
for warning in (
    ("not positive", "is not positive definite", INERTIA, INERTIA.replace('iyy="1.6"', 'iyy="-1"')),
    ("not definite", "is not positive definite", INERTIA, INERTIA.replace('ixy="0"', 'ixy="1.6"')),
    ("triangle rule", "breaks the triangle rule", INERTIA, INERTIA.replace('izz="1.7"', 'izz="9"')),
    ("kg mm2", "is it in kg·mm² (divide by 1e6)", INERTIA, '<inertia ixx="1.5e6" ixy="0" ixz="0" iyy="1.6e6" iyz="0" izz="1.7e6"/>'),
    ("too dense", "is too small for 30 kg", INERTIA, '<inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/>'),
    ("two inertials", "a second <inertial> in <link>", "<visual>", f'{MARK}<inertial><mass value="1"/></inertial><visual>'),
    ("two masses", "a second <mass> in <inertial>", '<mass value="30"/>', '<mass value="30"/><mass value="40"/>'),
):
    add_warning(*warning)
for case in (
    ("no inertia", "error", "has no <inertia>; add it", BASE.replace(INERTIA, "").replace("<inertial>", f"{MARK}<inertial>", 1)),
    ("inertia without mass", "warning", "has an inertia but the mass 0", BASE.replace('<mass value="30"/>', '<mass value="0"/>').replace(INERTIA, MARK + INERTIA)),
):
    add_case(*case)
add_change("point mass", "info", 'link "base" is a point mass', INERTIA, '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>')

# Names and structure.
for error in (
    ("no link name", "<link> without a name; name it", '<link name="arm">', "<link>"),
    ("no joint name", "<joint> without a name; name it", '<joint name="slide" ', "<joint "),
    ("two links of a name", 'link "base" is already at line 4; rename one', '<link name="arm">', '<link name="base">'),
    ("two joints of a name", 'joint "shoulder" is already at line 43; rename', '<joint name="slide" ', '<joint name="shoulder" '),
    ("reserved name", 'joint "root_joint" has a name that Pinocchio reserves', '<joint name="slide" ', '<joint name="root_joint" '),
    ("universe", 'joint "universe" has a name that Pinocchio reserves', '<joint name="slide" ', '<joint name="universe" '),
    ("unknown parent", 'joint "slide" names an unknown link "hand"', '<joint name="slide" type="prismatic">\n    <parent link="arm"/>', f'{MARK}<joint name="slide" type="prismatic">\n    <parent link="hand"/>'),
    ("unknown child", 'joint "slide" names an unknown link "thumb"', '<joint name="slide" type="prismatic">\n    <parent link="arm"/>\n    <child link="blade"/>', f'{MARK}<joint name="slide" type="prismatic">\n    <parent link="arm"/>\n    <child link="thumb"/>'),
    ("no parent", 'joint "slide" has no <parent link="...">', '<joint name="slide" type="prismatic">\n    <parent link="arm"/>', '<joint name="slide" type="prismatic">'),
    ("empty child", 'joint "slide" has no <child link="...">', '<joint name="slide" type="prismatic">\n    <parent link="arm"/>\n    <child link="blade"/>', '<joint name="slide" type="prismatic">\n    <parent link="arm"/><child link=""/>'),
    ("two parents", 'link "arm" has two parents: joints "shoulder" and "slide"', '<joint name="slide" type="prismatic">\n    <parent link="arm"/>\n    <child link="blade"/>', '<joint name="slide" type="prismatic">\n    <parent link="base"/>\n    <child link="arm"/>'),
    ("a link of its own", 'link "arm" is in a cycle', '<joint name="shoulder" type="revolute">\n    <parent link="base"/>', '<joint name="shoulder" type="revolute">\n    <parent link="arm"/>'),
    ("a cycle of two", 'link "arm" is in a cycle', '<joint name="shoulder" type="revolute">\n    <parent link="base"/>', '<joint name="shoulder" type="revolute">\n    <parent link="blade"/>'),
):
    add_error(*error)
for warning in (
    ("misspelt", "did you mean <inertial>?", "<visual>", f"{MARK}<inertal/><visual>"),
    ("misspelt limit", "did you mean <limit>?", '<limit lower="-2"', f'{MARK}<limits lower="-2"'),
):
    add_warning(*warning)
for case in (
    ("two roots", "error", '2 root links ("base", "spare"); join them', BASE.replace("<robot ", f"{MARK}<robot ").replace("</robot>", '<link name="spare"/></robot>')),
    ("no root", "error", "the joints form a cycle", f'{MARK}<robot name="r"><link name="a"/><link name="b"/><joint name="p" type="fixed"><parent link="a"/><child link="b"/></joint><joint name="q" type="fixed"><parent link="b"/><child link="a"/></joint></robot>'),
    ("no links", "error", "the robot has no <link>", f'{MARK}<robot name="r"/>'),
    ("no name", "warning", "<robot> has no name; it is called", BASE.replace('<robot name="r">', f"{MARK}<robot>")),
):
    add_case(*case)

# Joints.
for error in (
    ("no type", 'joint "slide" has no type; use one of', 'name="slide" type="prismatic"', f'{MARK}name="slide"'),
    ("wrong type", 'joint "slide" has type "rotary"; use one of', 'name="slide" type="prismatic"', f'{MARK}name="slide" type="rotary"'),
    ("capital type", 'has type "Fixed"; use one of', 'name="slide" type="prismatic"', f'{MARK}name="slide" type="Fixed"'),
    ("floating", 'joint "slide" is floating; rpctl places the base itself', 'name="slide" type="prismatic"', f'{MARK}name="slide" type="floating"'),
    ("planar", 'joint "slide" is planar', 'name="slide" type="prismatic"', f'{MARK}name="slide" type="planar"'),
    ("zero axis", 'axis of joint "shoulder" is zero', '<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'),
    ("vanishing axis", 'axis of joint "shoulder" is zero', '<axis xyz="0 0 1"/>', '<axis xyz="0 0 1e-200"/>'),
    ("short axis", "has 2 numbers; give 3", '<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>'),
    ("axis without xyz", '<axis xyz="', '<axis xyz="0 0 1"/>', '<axis xyz="a b c"/>'),
):
    add_error(*error)
for warning in (
    ("long axis", 'axis of joint "shoulder" has length 2;', '<axis xyz="0 0 1"/>', '<axis xyz="0 0 2"/>'),
    ("diagonal axis", "has length 1.41421;", '<axis xyz="0 0 1"/>', '<axis xyz="0 1 1"/>'),
):
    add_warning(*warning)
LIMIT = '<limit lower="-2" upper="2" effort="9" velocity="3"/>'
for error in (
    ("limits reversed", 'joint "shoulder" has lower 2 > upper -2; swap', LIMIT, '<limit lower="2" upper="-2" effort="9" velocity="3"/>'),
    ("limit is nan", '<limit lower="nan"> is not finite', LIMIT, '<limit lower="nan" upper="1" effort="9" velocity="3"/>'),
    ("limit is a word", '<limit upper="pi"> is not a number', LIMIT, '<limit lower="0" upper="pi" effort="9" velocity="3"/>'),
    ("damping", '<dynamics damping="x"> is not a number', LIMIT, LIMIT + '<dynamics damping="x"/>'),
):
    add_error(*error)
for warning in (
    ("limits of nothing", 'joint "shoulder" cannot move', LIMIT, '<limit effort="9" velocity="3"/>'),
    ("limits out of reach", "lower limit -1e+16", LIMIT, '<limit lower="-1e+16" upper="1e+16" effort="9" velocity="3"/>'),
    ("limits in degrees", 'limits -180 and 180 of joint "shoulder" are read as rad; if they are degrees', LIMIT, '<limit lower="-180" upper="180" effort="9" velocity="3"/>'),
    ("origin in mm", 'is 200 m from its parent\'s origin; if lengths are in mm', '<origin xyz="0.2 0 0.4"/>', '<origin xyz="200 0 0.4"/>'),
    ("negative effort", "effort limit -9", LIMIT, '<limit lower="-2" upper="2" effort="-9" velocity="3"/>'),
    ("negative velocity", "velocity limit -3", LIMIT, '<limit lower="-2" upper="2" effort="9" velocity="-3"/>'),
    ("effort of -1", 'effort limit -1 of joint "shoulder" is treated as no limit', LIMIT, '<limit lower="-2" upper="2" effort="-1" velocity="3"/>'),
    ("velocity of -1", 'velocity limit -1 of joint "shoulder" is treated as no limit', LIMIT, '<limit lower="-2" upper="2" effort="9" velocity="-1"/>'),
    ("zero velocity", 'velocity limit 0 of joint "shoulder" is ignored', LIMIT, '<limit lower="-2" upper="2" effort="9" velocity="0"/>'),
    ("vanishing velocity", 'velocity limit 1e-160 of joint "shoulder" is ignored', LIMIT, '<limit lower="-2" upper="2" effort="9" velocity="1e-160"/>'),
    ("two limits", "a second <limit> in <joint>", LIMIT, LIMIT + "<limit/>"),
):
    add_warning(*warning)
add_case("no limit", "warning", 'joint "shoulder" has no <limit>; rpctl treats it as unlimited', BASE.replace(LIMIT, "").replace('<joint name="shoulder"', f'{MARK}<joint name="shoulder"'))

# Mimics.
for error in (
    ("mimic: unknown", 'joint "shoulder" mimics an unknown joint "thumb"', LIMIT, LIMIT + '<mimic joint="thumb"/>'),
    ("mimic: itself", 'joint "shoulder" mimics itself', LIMIT, LIMIT + '<mimic joint="shoulder"/>'),
    ("mimic: no joint", '<mimic> of joint "shoulder" has no attribute "joint"', LIMIT, LIMIT + "<mimic/>"),
    ("mimic: no number", '<mimic multiplier="two"> is not a number', LIMIT, LIMIT + '<mimic joint="slide" multiplier="two"/>'),
):
    add_error(*error)
add_warning("mimic: multiplier 0", 'joint "shoulder" mimics with multiplier 0', LIMIT, LIMIT + '<mimic joint="slide" multiplier="0"/>')
GRIP = '<limit lower="0" upper="0.1" effort="5" velocity="1"/>'
for case in (
    ("mimic: circle", "error", "mimics itself in a loop (shoulder > slide)", BASE.replace(LIMIT, f'{MARK}<mimic joint="slide"/>{LIMIT}').replace(GRIP, '<mimic joint="shoulder"/>' + GRIP)),
    ("mimic: chain", "warning", ('joint "slide" mimics "shoulder", itself a mimic; rpctl resolves '
                                'it to "left_joint"'), BASE.replace(LIMIT, '<mimic joint="left_joint"/>' + LIMIT).replace(GRIP, f'{MARK}<mimic joint="shoulder"/>{GRIP}')),
    ("mimic: fixed", "error", 'mimics joint "slide", which is fixed', BASE.replace('"slide" type="prismatic"', '"slide" type="fixed"').replace(LIMIT, f'{MARK}<mimic joint="slide"/>{LIMIT}')),
):
    add_case(*case)

# Shapes.
BOX = '<box size="0.5 0.4 0.2"/>'
add_error("size is no number", '<box size="a b c"> is not a number', BOX, '<box size="a b c"/>')
for warning in (
    ("no shape", "<visual> without a shape", f"<visual>\n      <geometry>{BOX}</geometry>", f"{MARK}<visual>"),
    ("two shapes", "a second shape in <geometry>", BOX, BOX + BOX),
    ("strange shape", "<cone> is not a URDF shape", BOX, "<cone/>"),
    ("negative size", "<box> has a size that is not positive", BOX, '<box size="-0.5 0.4 0.2"/>'),
    ("huge size", "<box> is over 100 m large; is it in mm?", BOX, '<box size="500 400 200"/>'),
    ("mesh without a name", "<mesh> without a filename", BOX, "<mesh/>"),
    ("mesh of scale 0", "<mesh> with a scale of 0", BOX, '<mesh filename="a.stl" scale="0 1 1"/>'),
    ("colour of 255", "leaves [0, 1]; divide 0-255 by 255", '<material name="red"><color rgba="1 0 0 1"/>', '<material name="red"><color rgba="255 0 0 1"/>'),
    ("colour is no number", '<color rgba="red"> is not a number', '<material name="red"><color rgba="1 0 0 1"/>', '<material name="red"><color rgba="red"/>'),
):
    add_warning(*warning)

# XML.
for error in (
    ("attribute twice", "Attribute value redefined", '<mass value="30"/>', '<mass value="30" value="31"/>'),
    ("no quotes", "not well-formed XML", '<mass value="30"/>', "<mass value=30/>"),
    ("ampersand", "not well-formed XML", '<mass value="30"/>', '<mass value="30"/> a & b'),
    ("two documents", "Extra content at the end", "</robot>\n", f"</robot>\n{MARK}<robot/>"),
    ("control character", "not well-formed XML: PCDATA invalid Char value 1", '<mass value="30"/>', "\x01"),
):
    add_error(*error)
for case in (
    ("empty", "error", "the file is empty", ""),
    ("blanks", "error", "the file is empty", " \n\t\n"),
    ("text", "error", 'not XML: it begins with "wheels: 2"', f"{MARK}wheels: 2"),
    ("only comments", "error", "truncated before its root element", "<!-- a -->"),
    ("truncated in a tag", "error", "the file is truncated", without(BASE[BASE.index('link="blade"/>') :])),
    ("truncated in a comment", "error", "<!-- is never closed", f"{MARK}<!-- a robot"),
    ("truncated after a tag", "error", "the file is truncated", BASE[: BASE.index("  <joint name")] + MARK),
    ("tag not closed", "error", "not well-formed XML: Opening and ending tag mismatch: link", BASE.replace("  </link>\n", "", 1).replace("</robot>", f"{MARK}</robot>")),
    ("deep", "error", "elements are nested over 256 deep", f'{MARK}<robot name="r">' + "<a>" * 300 + "</a>" * 300 + "</robot>"),
    ("doctype", "error", "a DOCTYPE is not part of URDF; remove it", f"\n{MARK}<!DOCTYPE robot>" + '<robot name="r"/>'),
    ("entities", "error", "rpctl never reads its entities", f"{MARK}<!DOCTYPE r [<!ENTITY a 'b'>]><robot/>"),
    ("sdf", "error", "this is SDF, not URDF; export", f'<?xml version="1.0"?>\n{MARK}<sdf version="1.6"></sdf>'),
    ("mjcf", "error", "this is MJCF, not URDF; export", f"{MARK}<mujoco></mujoco>"),
    ("collada", "error", "this is COLLADA, a mesh, not URDF", f'{MARK}<COLLADA xmlns="u"/>'),
    ("html", "error", "this is HTML, a page, not URDF; download the raw file", f"\n{MARK}<!DOCTYPE html><html></html>"),
    ("html without a doctype", "error", "this is HTML", f"{MARK}<html></html>"),
    ("svg", "error", "this is an SVG picture", f"{MARK}<svg/>"),
    ("srdf", "error", "this is an SRDF", f'{MARK}<robot name="r"><group name="arm"/></robot>'),
    ("launch", "error", "this is a ROS launch file", f"{MARK}<launch/>"),
    ("other root", "error", "the root element is <Robot>; a URDF's is <robot>", f"{MARK}<Robot/>"),
    ("json", "error", "this is JSON, not URDF", MARK + '{"robot": 1}'),
    ("yaml", "error", "this is YAML", f"{MARK}---\nrobot: 1"),
    ("stl", "error", "this is an STL mesh", f"{MARK}solid cube"),
    ("lfs", "error", "this is a Git LFS pointer, not URDF; run `git lfs pull`", f"{MARK}version https://git-lfs.github.com/spec/v1"),
    ("404", "error", "this is a server's error message", f"{MARK}404: Not Found"),
):
    add_case(*case)
for magic, kind in ((b"\x89PNG\r\n\x1a\n\0", "a PNG picture"), (b"PK\x03\x04\0", "a ZIP archive"),
                    (b"\x1f\x8b\x08\0", "a gzip archive"), (b"%PDF-1.4", "a PDF")):
    CASES.append(UrdfCase(kind, "error", f"this is {kind}, not URDF", magic, None))
CASES.append(UrdfCase("zero bytes", "error", "a zero byte", b"<robot>\n\0\0</robot>", 2))
for encoded in (
    ("xacro", "error", ("the file contains xacro that is not expanded (2 elements, the first is "
                       "<macro>)"), f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro">\n{MARK}<xacro:macro/><xacro:a/></robot>', "utf-16"),
    ("xacro undeclared", "error", "the file contains xacro that is not expanded", f'<robot name="r">\n{MARK}<xacro:macro/></robot>', "utf-16"),
):
    add_case(*encoded)

# Encodings and namespaces: mended, and said.
for warning in (
    ("undeclared prefix", 'the prefix "gz" is not declared', "<visual>", f"{MARK}<gz:plugin/><visual>"),
    ("undeclared prefix of an attribute", 'the prefix "xsi" is not declared', "<visual>", f'{MARK}<visual xsi:type="a">'),
):
    add_warning(*warning)
for mended in (
    ("default namespace", "warning", '<robot> is in the namespace "urn:x"; rpctl ignores the namespace', BASE.replace("<robot ", f'{MARK}<robot xmlns="urn:x" ')),
    ("prefixed urdf", "warning", 'in the namespace "urn:x"', f'{MARK}<u:robot xmlns:u="urn:x" name="r"><u:link name="a"/></u:robot>'),
    ("latin-1 as utf-8", "warning", "byte 0xE9 is not UTF-8, the file's encoding; rpctl reads it as Latin-1", BASE.replace('"red"><', f'"roug{MARK}é"><'), "latin-1"),
    ("unknown encoding", "warning", 'the declared encoding "klingon" is not the file\'s', MARK + BASE.replace("UTF-8", "klingon")),
    ("declared utf-16", "warning", 'the declared encoding "UTF-16" is not the file\'s', MARK + BASE.replace("UTF-8", "UTF-16")),
    ("blanks before the declaration", "warning", "blanks before <?xml; remove them", f"\n\n{MARK}{BASE}"),
):
    add_case(*mended)
CASES.append(UrdfCase("utf-16 cut in a character", "error", "not UTF-16 as its first bytes say", BASE.encode("utf-16")[:-3], None))
