"""Damaged meshes of every format: triangles that can be drawn, or one message; the reader lives."""

from __future__ import annotations

import json
from collections import Counter, OrderedDict
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
import trimesh

from rpctl.description.meshes import reading as mesh_files
from rpctl.description.meshes.jobs import MAX_COORDINATE
from rpctl.description.meshes.paths import MeshError
from rpctl.description.meshes.reading import read_mesh
from rpctl.description.meshes.service import StalledMeshError
from tests.description.meshes.bad_meshes import GLB_BINARY, dae_bomb, glb, glb_triangle

NUMBERS = ("0", "-1", "1e39", "1e309", "nan", "inf", "4294967296", "99999999999999999999", "", "x")
KINDS = ("stl", "ascii.stl", "obj", "ply", "binary.ply", "glb", "dae")
QUICK, LONG = 40, 1500  # files of each kind
SEED = 14


def seeds(kind: str) -> list[bytes]:
    """Return sound files of a kind."""
    box: Any = trimesh.creation.box()
    cone: Any = trimesh.creation.cone(0.2, 0.5, sections=6)
    if kind == "ascii.stl":
        return [each.export(file_type="stl_ascii").encode() for each in (box, cone)]
    if kind == "ply":
        return [each.export(file_type="ply", encoding="ascii") for each in (box, cone)]
    name = kind.rpartition(".")[2]
    exported = [each.export(file_type=name) for each in (box, cone)]
    files = [each if isinstance(each, bytes) else each.encode() for each in exported]
    return [*files, dae_bomb(3)] if kind == "dae" else files


def flip_bytes(data: bytes, random: Random) -> bytes:
    """Change a few bytes, most of them in the header."""
    damaged = bytearray(data)
    for _ in range(random.randint(1, 6)):
        place = random.randrange(min(len(damaged), random.choice((100, len(damaged)))))
        damaged[place] = random.choice((0, 1, 0x7F, 0x80, 0xFF, random.randrange(256)))
    return bytes(damaged)


def cut(data: bytes, random: Random) -> bytes:
    """Leave out a stretch, or double it."""
    begin, end = sorted(random.randrange(len(data) + 1) for _ in range(2))
    return data[:begin] + (data[begin:end] * 2 if random.random() < 0.5 else b"") + data[end:]


def exchange_word(data: bytes, random: Random) -> bytes:
    """Put an absurd number, or another word of the file, in the place of a word of a text."""
    words = data.replace(b'"', b' " ').replace(b"<", b" < ").split(b" ")
    place = random.randrange(len(words))
    other = random.choice((random.choice(NUMBERS).encode(), random.choice(words)))
    return (
        b" ".join([*words[:place], other, *words[place + 1 :]])
        .replace(b' " ', b'"')
        .replace(b" < ", b"<")
    )


def exchange_value(data: bytes, random: Random) -> bytes:
    """Change a number or a part of a GLB's header."""
    header = glb_triangle()
    at: Any = header
    while isinstance(at, dict | list) and at:
        key = random.choice(list(at) if isinstance(at, dict) else range(len(at)))
        inner = at[key]
        if not isinstance(inner, dict | list) or random.random() < 0.2:
            values: tuple[Any, ...] = (-1, 0, 1, 2**31, 2**70, 1e300, None, "x", [], {}, True)
            at[key] = random.choice(values)
            break
        at = inner
    return glb(json.loads(json.dumps(header)), GLB_BINARY)


DAMAGES: dict[str, tuple[Callable[[bytes, Random], bytes], ...]] = {
    "text": (exchange_word, exchange_word, cut, flip_bytes),
    "binary": (flip_bytes, flip_bytes, cut),
    "glb": (exchange_value, exchange_value, flip_bytes, cut),
}


def outcome(path: Path) -> str:
    """Return what became of a file: ``"mesh"``, or ``"fault"``."""
    try:
        mesh = read_mesh(path)
    except MeshError as error:
        assert not isinstance(error, StalledMeshError), error
        assert str(error).isprintable()
        assert "no mesh" not in str(error), "the reader answered with what is none"
        return "fault"
    for surface in mesh.surfaces:
        assert np.abs(surface.vertices).max() <= MAX_COORDINATE
        assert 0 <= surface.faces.min() <= surface.faces.max() < len(surface.vertices)
    return "mesh"


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        *((kind, QUICK) for kind in KINDS),
        *(pytest.param(kind, LONG, marks=pytest.mark.thorough) for kind in KINDS),
    ],
)
def test_damaged_meshes_are_read_or_refused(
    kind: str, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_files, "KEPT", OrderedDict())
    random, sound = Random(f"{SEED} {kind}"), seeds(kind)
    text = kind in ("ascii.stl", "obj", "ply", "dae")
    damages = DAMAGES["glb" if kind == "glb" else "text" if text else "binary"]
    path, found = tmp_path / f"a.{kind}", Counter[str]()
    for data in sound:
        path.write_bytes(data)
        assert outcome(path) == "mesh"
    for number in range(count):
        damaged = random.choice(sound)
        for _ in range(random.randint(1, 2)):
            damaged = random.choice(damages)(damaged or b"\0", random)
        path.write_bytes(damaged)
        try:
            found[outcome(path)] += 1
        except BaseException:
            print(f"file {number} of seed {SEED}: {damaged[:2000]!r}")
            raise
    assert found["mesh"] > 0.02 * count, found
    assert found["fault"] > 0.1 * count, found
