"""Meshes that are bombs, absurd or damaged: each is refused by name, at little cost."""

from __future__ import annotations

import os
import time
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
import trimesh

from rpctl.description.meshes import reading as mesh_files
from rpctl.description.meshes import service as mesh_service
from rpctl.description.meshes.jobs import shade, weld
from rpctl.description.meshes.paths import MeshError, MeshPaths
from rpctl.description.meshes.reading import Mesh, read_mesh, read_shape
from rpctl.description.meshes.service import MeshService, StalledMeshError
from rpctl.files.array_messages import pack, unpack
from tests.description.meshes.bad_meshes import (
    BAD,
    GLB_BINARY,
    TRIANGLE,
    dae,
    dae_bomb,
    glb,
    glb_triangle,
    obj,
    ply,
    polygon,
    stl,
)

STUBBORN = "tests.description.meshes.stubborn_worker"
HUGE = 2**20  # bytes of an answer


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for meshes, of which none was read before."""
    monkeypatch.setattr(mesh_files, "KEPT", OrderedDict())
    return tmp_path


@pytest.mark.parametrize("name", BAD)
def test_a_bad_mesh_is_refused_by_what_is_wrong_with_it(name: str, folder: Path) -> None:
    content, expected = BAD[name]
    (folder / name).write_bytes(content)
    with pytest.raises(MeshError) as caught:
        read_mesh(folder / name)
    assert expected in str(caught.value)
    assert not isinstance(caught.value, StalledMeshError)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", stl(TRIANGLE)),
        ("a.obj", obj(TRIANGLE, [(1, 2, 3)])),
        ("back.obj", obj(TRIANGLE, [(-3, -2, -1)])),
        ("a.ply", ply(TRIANGLE, [(0, 1, 2)], comment="TextureFile a.mtl")),
        ("a.dae", dae()),
        ("twice.dae", dae(scene='<node><instance_geometry url="#g"/></node>' * 2)),
        ("a.glb", glb(glb_triangle(), GLB_BINARY)),
    ],
)
def test_what_is_near_to_a_bad_mesh_is_read(name: str, content: bytes, folder: Path) -> None:
    (folder / name).write_bytes(content)
    mesh = read_mesh(folder / name)
    assert mesh.remarks == ()
    (surface,) = mesh.surfaces
    assert len(surface.faces) == 1 + (name == "twice.dae")
    np.testing.assert_allclose(surface.vertices[surface.faces[0]], TRIANGLE, atol=1e-7)
    assert not surface.vertices.flags.writeable
    assert not surface.faces.flags.writeable


def test_only_regular_files_within_their_cap_are_read(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(folder / "pipe.stl")
    with pytest.raises(MeshError, match="not readable: a pipe, not a regular file"):
        read_mesh(folder / "pipe.stl")
    (folder / "a.stl").write_bytes(stl(TRIANGLE))
    monkeypatch.setenv("RPCTL_MAX_MESH_BYTES", "134")
    assert read_mesh(folder / "a.stl").surfaces
    monkeypatch.setenv("RPCTL_MAX_MESH_BYTES", "133")
    with pytest.raises(MeshError, match=r"over 133 bytes;.*RPCTL_MAX_MESH_BYTES"):
        read_mesh(folder / "a.stl")


def test_what_a_dae_shows_is_counted_to_the_piece(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "a.dae").write_bytes(dae_bomb(3))
    monkeypatch.setenv("RPCTL_MAX_MESH_PARTS", "8")
    monkeypatch.setenv("RPCTL_MAX_MESH_TRIANGLES", "8")
    assert len(read_mesh(folder / "a.dae").surfaces[0].faces) == 8
    monkeypatch.setenv("RPCTL_MAX_MESH_PARTS", "7")
    with pytest.raises(
        MeshError, match=r"shows 8 parts, but at most 7 are allowed.*MAX_MESH_PARTS"
    ):
        read_mesh(folder / "a.dae")
    monkeypatch.setenv("RPCTL_MAX_MESH_TRIANGLES", "7")
    with pytest.raises(
        MeshError, match=r"shows 8 triangles, but at most 7 are.*MAX_MESH_TRIANGLES"
    ):
        read_mesh(folder / "a.dae")


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "glb", "dae"])
def test_triangles_are_capped_in_every_format(
    kind: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = folder / f"a.{kind}"
    trimesh.creation.box().export(path)
    monkeypatch.setenv("RPCTL_MAX_MESH_TRIANGLES", "12")
    assert sum(len(each.faces) for each in read_mesh(path).surfaces) == 12
    monkeypatch.setenv("RPCTL_MAX_MESH_TRIANGLES", "11")
    with pytest.raises(MeshError, match="shows 12 triangles, but at most 11 are allowed"):
        read_mesh(path)


def test_loose_vertices_are_left_out_and_told(folder: Path) -> None:
    """One of them, 9 m away, would make a wheel of it that is no wheel."""
    (folder / "a.ply").write_bytes(ply([*TRIANGLE, (9.0, 0.0, 0.0), (0.2, 0.2, 0.0)], [(0, 1, 2)]))
    mesh = read_mesh(folder / "a.ply")
    assert mesh.surfaces[0].vertices.max() == 1.0
    assert mesh.remarks == (
        "a vertex lies beyond its triangles, belong to none of them, and are ignored",
    )


@pytest.mark.parametrize(
    ("scale", "expected"),
    [
        ((1e5, 1.0, 1.0), "reaches 1e+05 m from its frame at a scale of 100000.0 1.0 1.0"),
        ((-1.0, -2e4, 1.0), "reaches 2e+04 m"),
        ((1e300, 1e300, 1e300), "reaches 1e+300 m"),
        ((1e-7, 1e-7, 1e-7), "is 1e-07 m large"),
        ((1e-300, 1e-300, 1e-300), "is 1e-300 m large"),
        ((0.001, 1000.0, -1.0), ""),
    ],
)
def test_a_scale_makes_a_part_of_a_robot(
    scale: tuple[float, ...], expected: str, folder: Path
) -> None:
    (folder / "a.stl").write_bytes(stl(TRIANGLE))
    paths = MeshPaths(folder / "a.urdf")
    if not expected:
        assert read_shape("a.stl", scale, paths).surfaces
        return
    with pytest.raises(MeshError) as caught:
        read_shape("a.stl", scale, paths)
    assert expected in str(caught.value)


def test_a_fan_is_shaded_without_pairing_all_its_corners() -> None:
    """30 000 corners at one vertex are 900 million pairs: 6.7 GB."""
    count = 30_000
    rim = np.array(polygon(count))
    faces = np.column_stack(
        [np.arange(1, count - 1), np.arange(2, count), np.zeros(count - 2, int)]
    )
    shaded = shade(rim, faces)
    assert (shaded.normals == [0, 0, 127]).all()
    assert len(shaded.faces) == count - 2


def test_a_smooth_fan_is_shaded_smoothly() -> None:
    cone = trimesh.creation.cone(1.0, 0.3, sections=60)
    shaded = shade(*weld(np.asarray(cone.vertices), np.asarray(cone.faces)))
    top = shaded.normals[shaded.vertices[:, 2] > 0.29]
    assert len(top) == 1
    assert top[0][2] == 127


# The process that reads.


def asked(service: MeshService, job: str, head: Mapping[str, str] = MappingProxyType({})) -> Any:
    """Return what a service answers but for arrays."""
    return unpack(service.ask(pack({"job": job, **head})))[0]


def test_what_was_asked_before_is_read_from_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not so what was asked in vain; another question is another thing."""
    size = {"kind": "sphere", "size": [0.123]}
    first = mesh_service.ask("primitive", size, [])
    monkeypatch.setattr(MeshService, "_start", lambda self: pytest.fail("a process was started"))
    mesh_service.close()
    head, arrays = mesh_service.ask("primitive", size, [])
    assert head == first[0]
    for found, expected in zip(arrays, first[1], strict=True):
        np.testing.assert_array_equal(found, expected)
    with pytest.raises(pytest.fail.Exception):
        mesh_service.ask("primitive", {**size, "size": [0.124]}, [])


def test_a_mesh_that_ends_its_reader_costs_itself_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    service = MeshService(STUBBORN)
    try:
        assert asked(service, "echo", {"word": "a"})["word"] == "a"
        with pytest.raises(
            StalledMeshError, match=r"the reading process ended.*RPCTL_MAX_MESH_MEMORY"
        ):
            asked(service, "abort")
        assert asked(service, "echo", {"word": "b"})["word"] == "b"
        monkeypatch.setenv("RPCTL_MAX_MESH_SECONDS", "1")
        began = time.monotonic()
        with pytest.raises(StalledMeshError, match=r"over 1 s;.*RPCTL_MAX_MESH_SECONDS"):
            asked(service, "sleep")
        assert time.monotonic() - began < 30.0  # it sleeps for ever
        assert asked(service, "echo", {"word": "c"})["word"] == "c"
    finally:
        service.close()


def test_a_lack_of_memory_is_a_message_and_the_reader_goes_on() -> None:
    service = MeshService(STUBBORN)
    try:
        process = asked(service, "process")["id"]
        with pytest.raises(MeshError, match=r"too much memory.*RPCTL_MAX_MESH_MEMORY"):
            asked(service, "grow")
        assert asked(service, "process")["id"] == process
    finally:
        service.close()


def test_an_idle_reader_ends_and_another_one_takes_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mesh_service, "IDLE_S", 0.05)
    service = MeshService(STUBBORN)
    try:
        first = asked(service, "process")["id"]
        deadline = time.monotonic() + 30.0
        while _runs(first) and time.monotonic() < deadline:
            time.sleep(0.02)
        assert not _runs(first)
        assert asked(service, "process")["id"] != first
    finally:
        service.close()


def _runs(process: int) -> bool:
    """Whether a process runs; one that has ended and was not waited for does not."""
    stat = Path(f"/proc/{process}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_forked_process_has_its_own_reader() -> None:
    """Two that talk into one pipe would read each other's meshes."""
    before = mesh_service.SERVICE
    child = os.fork()
    if not child:
        os._exit(0 if mesh_service.SERVICE is not before else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert mesh_service.SERVICE is before


def test_meshes_after_the_second_that_stalls_are_not_tried(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[bytes] = []

    def stall(job: str, head: Any, arrays: Any) -> Any:
        asked.append(arrays[0].tobytes())
        raise StalledMeshError("refused: it takes too long")

    monkeypatch.setattr(mesh_files, "ask", stall)
    for k in range(4):
        (folder / f"{k}.stl").write_bytes(stl(TRIANGLE) + bytes(k))
    paths = MeshPaths(folder / "a.urdf")
    for name, expected in (("0", "long"), ("0", "long"), ("1", "long"), ("2", "2 other meshes")):
        with pytest.raises(MeshError, match=expected):
            read_shape(f"{name}.stl", (1.0, 1.0, 1.0), paths)
    assert len(asked) == 2


CORNERS = np.array(TRIANGLE, "<f8")
FACES = np.array([[0, 1, 2]], "<u4")


@pytest.mark.parametrize(
    ("head", "arrays"),
    [
        ({}, [CORNERS, FACES]),
        ({"colours": [], "remarks": []}, []),
        ({"colours": [None, None], "remarks": []}, [CORNERS, FACES]),
        ({"colours": [[1, 0, 0]], "remarks": []}, [CORNERS, FACES]),
        ({"colours": [[1, 0, 0, 2]], "remarks": []}, [CORNERS, FACES]),
        ({"colours": ["red"], "remarks": []}, [CORNERS, FACES]),
        ({"colours": [None], "remarks": None}, [CORNERS, FACES]),
        ({"colours": [None], "remarks": []}, [CORNERS * np.nan, FACES]),
        ({"colours": [None], "remarks": []}, [CORNERS * 1e10, FACES]),
        ({"colours": [None], "remarks": []}, [CORNERS.astype("<f4"), FACES]),
        ({"colours": [None], "remarks": []}, [CORNERS[:, :2], FACES]),
        ({"colours": [None], "remarks": []}, [CORNERS, FACES + 1]),
        ({"colours": [None], "remarks": []}, [CORNERS, FACES[:0]]),
        ({"colours": [None], "remarks": []}, [CORNERS, FACES.reshape(-1)]),
    ],
)
def test_a_reader_that_was_taken_over_is_not_believed(
    head: Any, arrays: Any, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_files, "ask", lambda *_: (head, arrays))
    (folder / "a.stl").write_bytes(stl(TRIANGLE))
    with pytest.raises(MeshError, match="the reading process returned no mesh"):
        read_mesh(folder / "a.stl")


def test_a_faults_text_is_one_printable_line(monkeypatch: pytest.MonkeyPatch) -> None:
    service = MeshService(STUBBORN)
    message = pack({"fault": "a\x1b[2J\nb" + "c" * 1000})
    monkeypatch.setattr(service, "_ask", lambda request, most: message)
    with pytest.raises(MeshError) as caught:
        asked(service, "echo")
    assert str(caught.value).startswith("a[2Jbccc")
    assert len(str(caught.value)) == mesh_service.MAX_FAULT


def test_meshes_are_kept_by_their_bytes_and_within_a_budget(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = folder / "a.stl"
    path.write_bytes(stl(TRIANGLE))
    first = read_mesh(path)
    assert read_mesh(path) is first
    path.write_bytes(stl((np.asarray(TRIANGLE) * 2.0).tolist()))
    assert read_mesh(path).surfaces[0].vertices.max() == 2.0
    monkeypatch.setattr(mesh_files, "KEPT_BYTES", 0)
    second = read_mesh(path)
    assert second.surfaces[0].vertices.max() == 2.0
    path.write_bytes(stl((np.asarray(TRIANGLE) * 3.0).tolist()))
    third: Mesh = read_mesh(path)
    assert read_mesh(path) is not third
