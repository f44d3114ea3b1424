"""What the proof's modules ask of the rooms above: names, and no number that they prove."""

from __future__ import annotations

import ast
from pathlib import Path
from types import ModuleType

import pytest

from rpctl.equivalence import (
    file_drive,
    file_wheels,
    gibbs_appell,
    mujoco_engine,
    planar,
    raw_file,
    rolling_rows,
    tree,
    wheel_slip,
)
from rpctl.equivalence.contact import model, mujoco_body

MODEL = {"model", "crba", "rnea", "basis", "forwardKinematics", "createData"}
READING = {"xml", "model", "child_joints", "parent_joint", "frozen_tree", "FrozenTree"}
SIMULATED = ("pinocchio", "rpctl.dynamics")
READ = ("rpctl.description", "rpctl.drive", "rpctl.robot")
RECORDS = {  # of the rooms above: meshes are opened through them, and records are named
    "rpctl.description.meshes.reading",
    "rpctl.description.meshes.paths.MeshError",
    "rpctl.description.meshes.paths.MeshPaths",
    "rpctl.drive.drive.Drive",
    "rpctl.drive.drive.Swivel",
    "rpctl.drive.drive.Wheel",
    "rpctl.robot.model.Robot",
}
STANCE = {  # which parts stand on the ground, by name
    "rpctl.dynamics.stance.Supports",
    "rpctl.dynamics.stance.find_supports",
}
GIBBS_APPELL = ("rpctl.equivalence.gibbs_appell", "rpctl.equivalence.planar")
READERS = (raw_file, file_wheels, file_drive, wheel_slip)
ASKED = {  # rooms that a module may ask for some names alone, those, and attributes that it has not
    gibbs_appell: (SIMULATED, set(), MODEL),
    mujoco_engine: ((*SIMULATED, *GIBBS_APPELL), set(), MODEL),
    rolling_rows: ((*SIMULATED, *GIBBS_APPELL), set(), MODEL),
    **dict.fromkeys((model, mujoco_body), (SIMULATED, STANCE, MODEL)),
    **dict.fromkeys(READERS, (READ, RECORDS, READING | {"tree"})),
    **dict.fromkeys((tree, planar), (("rpctl.description",), set(), READING)),
}


@pytest.mark.parametrize("module", ASKED, ids=lambda module: module.__name__.split(".")[-1])
def test_a_module_asks_for_no_number_that_it_proves(module: ModuleType) -> None:
    rooms, allowed, forbidden = ASKED[module]
    nodes = list(ast.walk(ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))))
    imported = set()
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            above = f"{node.module}." if isinstance(node, ast.ImportFrom) else ""
            imported |= {f"{above}{alias.name}" for alias in node.names}
    assert {name for name in imported if name.startswith(rooms)} <= allowed
    assert not {node.attr for node in nodes if isinstance(node, ast.Attribute)} & forbidden
