"""Seeded damage to URDF files: bytes, attributes, elements, structure."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

from lxml import etree

VALUES = (
    "", " ", "0", "-1", "1e999", "1e308", "-1e308", "1e-320", "1e16", "nan", "inf", "-inf", "1,5",
    "1.5kg", "${m}", "0x10", "1_0", "１", "1 2", "1 2 3", "0 0 0", "0 0 1e-9", "1e200 0 0",
    "nan nan nan", "1&#10;2&#9;3", "&#160;1", "a", "a" * 5000, "9" * 5000, "../../etc/passwd",
    "file:///etc/passwd", "package://no/mesh.stl", "/dev/zero", "root_joint", "universe",
    "base_link", "\u202e", "&lt;b&gt;", "[/bold]", "%s%n", "fixed", "revolute", "continuous",
    "prismatic", "floating", "planar", "1e5 1e5 1e5", "123456789", "-0", "+1", ".5", "5.", "1e+2",
    "--1", "é", "None", "true",
)  # fmt: skip
TOKENS = (
    b"<", b">", b"/>", b'"', b"&", b"&x;", b"<!--", b"-->", b"]]>", b"<![CDATA[", b"<?x", b"\0",
    b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"xmlns='u'", b"<x:y/>", b"<!DOCTYPE r>",
    b"<!ENTITY a 'b'>", b"</robot>", b"<robot>", b"<link name='n'/>", b"\xc3\x28", b"\n" * 50,
)  # fmt: skip
TAGS = (
    "link", "joint", "inertial", "mass", "inertia", "origin", "axis", "limit", "mimic", "parent",
    "child", "visual", "collision", "geometry", "box", "sphere", "cylinder", "mesh", "dynamics",
    "safety_controller", "robot", "gazebo", "inertal",
)  # fmt: skip
ATTRIBUTES = (
    "name", "type", "link", "joint", "xyz", "rpy", "value", "ixx", "ixy", "izz", "lower", "upper",
    "effort", "velocity", "multiplier", "offset", "filename", "scale", "radius", "length", "size",
    "rgba", "version", "quat_xyzw", "damping",
)  # fmt: skip
ATTRIBUTE = re.compile(rb'([\w:]+)="([^"<>]*)"')

Mutation = Callable[[bytes, Random], bytes]


def flip_bits(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(random.randint(1, 8)):
        changed[random.randrange(len(changed))] ^= 1 << random.randrange(8)
    return bytes(changed)


def cut(data: bytes, random: Random) -> bytes:
    a, b = sorted(random.randrange(len(data)) for _ in range(2))
    if random.random() < 0.5:
        b = min(b, a + 60)
    return data[:a] + data[b:]


def truncate(data: bytes, random: Random) -> bytes:
    return data[: random.randrange(len(data))]


def repeat(data: bytes, random: Random) -> bytes:
    a = random.randrange(len(data))
    return data[:a] + data[a : a + random.randint(1, 400)] * 2 + data[a:]


def insert(data: bytes, random: Random) -> bytes:
    a = random.randrange(len(data))
    token = random.choice((*TOKENS, random.randbytes(random.randint(1, 6))))
    return data[:a] + token + data[a:]


def recode(data: bytes, random: Random) -> bytes:
    text = data.decode("utf-8").replace('encoding="utf-8"', "")
    codec = random.choice(("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "latin-1", "cp037"))
    coded = text.encode(codec, "replace")
    return coded[: random.randrange(len(coded))] if random.random() < 0.2 else coded


def set_value(data: bytes, random: Random) -> bytes:
    for _ in range(random.randint(1, 3)):
        found = random.choice(list(ATTRIBUTE.finditer(data)))
        others = [m[2] for m in ATTRIBUTE.finditer(data) if m[1] == found[1]]
        value = random.choice((*(v.encode() for v in VALUES), *random.sample(others, 1) * 8))
        data = data[: found.start(2)] + value + data[found.end(2) :]
    return data


def scale_value(data: bytes, random: Random) -> bytes:
    """Multiply the numbers of one attribute, by a factor and perhaps by -1."""
    found = random.choice(list(ATTRIBUTE.finditer(data)))
    factor = random.choice((-1.0, 1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e9, 1e-160, 1e160))
    try:
        value = " ".join(repr(factor * float(word)) for word in found[2].split()).encode()
    except ValueError:
        return data
    return data[: found.start(2)] + value + data[found.end(2) :]


def drop_attribute(data: bytes, random: Random) -> bytes:
    found = random.choice(list(ATTRIBUTE.finditer(data)))
    return data[: found.start()] + data[found.end() :]


def _with_tree(change: Callable[[list[etree._Element], Random], None]) -> Mutation:
    def mutate(data: bytes, random: Random) -> bytes:
        root = etree.fromstring(data, etree.XMLParser(remove_comments=True))
        for _ in range(random.randint(1, 3)):
            change(list(root.iter("*")), random)
        return bytes(etree.tostring(root))

    mutate.__name__ = change.__name__
    return mutate


def remove_element(elements: list[etree._Element], random: Random) -> None:
    element = random.choice(elements[1:])
    element.getparent().remove(element)


def copy_element(elements: list[etree._Element], random: Random) -> None:
    copied = etree.fromstring(etree.tostring(random.choice(elements[1:]), with_tail=False))
    target = random.choice(elements)
    target.insert(random.randint(0, len(target)), copied)


def rename_element(elements: list[etree._Element], random: Random) -> None:
    random.choice(elements).tag = random.choice(TAGS)


def rename_attribute(elements: list[etree._Element], random: Random) -> None:
    element = random.choice([e for e in elements if e.attrib])
    key = random.choice(list(element.attrib))
    element.set(random.choice(ATTRIBUTES), element.attrib.pop(key))


def swap_values(elements: list[etree._Element], random: Random) -> None:
    """Exchange an attribute between two elements of one tag: links, axes, types, masses."""
    first = random.choice([e for e in elements if e.attrib])
    second = random.choice([e for e in elements if e.tag == first.tag])
    for key in first.attrib:
        if key in second.attrib:
            ours, theirs = first.get(key), second.get(key)
            first.set(key, theirs)
            second.set(key, ours)


def rewire(elements: list[etree._Element], random: Random) -> None:
    """Hang a joint elsewhere, give it another type, or let it mimic another."""
    joints = [e for e in elements if e.tag == "joint" and len(e)]
    links = [e.get("name") or "" for e in elements if e.tag == "link"]
    if not joints or not links:
        return
    joint = random.choice(joints)
    what = random.randrange(4)
    if what == 3:
        followed = random.choice(joints).get("name") or ""
        etree.SubElement(joint, "mimic", joint=followed, multiplier=random.choice(VALUES[:8]))
    elif what == 2:
        joint.set("type", random.choice(("fixed", "revolute", "continuous", "prismatic")))
    else:
        for end in joint.findall(("parent", "child")[what]):
            end.set("link", random.choice(links))


MUTATIONS: tuple[Mutation, ...] = (
    flip_bits, cut, truncate, repeat, insert, recode, set_value, scale_value, drop_attribute,
    *map(_with_tree, (
        remove_element, copy_element, rename_element, rename_attribute, swap_values, rewire,
    )),
)  # fmt: skip


def damage(data: bytes, random: Random) -> tuple[str, bytes]:
    """Return what was done to a file, and the file after it: one to three mutations."""
    done = []
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        mutation = random.choice(MUTATIONS)
        try:
            data = mutation(data, random)
        except (etree.XMLSyntaxError, UnicodeError, IndexError, ValueError):
            continue  # what came before left nothing for this one to work on
        done.append(mutation.__name__)
    return "+".join(done), data
