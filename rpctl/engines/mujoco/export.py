"""``write_mjcf``: write a robot as MJCF; the file is read back, run and compared first.

The file runs without rpctl, so robots that plain MuJoCo cannot model are refused.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from rpctl import __version__
from rpctl.engines.mujoco.bodies import FREE, HOME, HOW, body_name, sensor_parts
from rpctl.engines.mujoco.certificate import MjcfCertificate
from rpctl.engines.mujoco.check import compare_tables
from rpctl.engines.mujoco.equations import Witness, compare_with_witness, take_witness
from rpctl.engines.mujoco.ground import has_rollers
from rpctl.engines.mujoco.mjcf_reader import StrictMjcf, parse_mjcf, tabulate
from rpctl.engines.mujoco.mjcf_writer import Drawn, draw, numbers, to_bytes, write_model
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.trial import run_on_ground, settle
from rpctl.engines.mujoco.world import Built, build
from rpctl.equivalence.certificate import Check, Skipped
from rpctl.equivalence.contact.model import SOLIMP
from rpctl.equivalence.contact.mujoco_body import mujoco_library
from rpctl.equivalence.verify import Certificate, verify
from rpctl.errors import RpctlError
from rpctl.files.writing import make_folder, require_writable, write_atomically
from rpctl.robot.inspection import model_digest
from rpctl.robot.model import Robot
from rpctl.robot.vary import without_losses

LINK_GROUP, CONTACT_GROUP = 4, 3  # of sites and of contact shapes; a viewer shows 0 to 2
HARD_STEPS = 4.0  # timesteps: time constant of the contacts of crowned wheels
READ_BACK = "the file read back"
VERIFIED_SAMPLES = 10  # states of the certificate of the equations
MESH_SUFFIX = "_meshes"  # of the folder of the meshes, beside the file


def prepare(robot: Robot, settings: ContactSettings, friction: float, hidden: bool = True) -> Built:
    """Return a robot as a MuJoCo model that needs nothing besides its file.

    Args:
        robot: The robot.
        settings: Contact settings. Crowned wheels do not scrub, so their contacts are as hard as
            the timestep allows: the robot neither sinks nor creeps.
        friction: Coefficient between wheels and ground.
        hidden: Whether the contact shapes are in a group that viewers do not show.

    Raises:
        RpctlError: Plain MuJoCo cannot model the robot; the message says why.
    """
    _require_possible(robot)
    built = build(robot, settings, friction)
    if built.heights is not None:
        raise RpctlError("a model with a height field cannot be exported; leave `heights` empty")
    spec = built.spec
    for body in spec.bodies:
        for joint in body.joints:
            joint.name = joint.name or f"{body.name}{FREE}"
    for site in spec.sites:
        site.group = LINK_GROUP
    for geom in spec.geoms:
        if hidden and geom.name in built.geoms:
            geom.group = CONTACT_GROUP
    if settings.wheel_shape == "crowned" and not has_rollers(robot):
        spec.option.impratio = 1.0
        for pair in spec.pairs:
            pair.solref, pair.solimp = [HARD_STEPS * settings.timestep, 1.0], SOLIMP
            pair.solreffriction = [0.0, 0.0]  # as solref
    for tie in spec.equalities:
        tie.name = tie.name or f"{tie.name1}_tie"
    if built.followers:
        leaders = ", ".join(swivel.joint for swivel in robot.drive.steered)
        loose = (
            f"{', '.join(built.followers)} follow {leaders} in a way that MuJoCo's constraints "
            "cannot express: in the file only their motors move them; hold each at its angle in "
            "robot.configuration(...)"
        )
        built = replace(built, notes=(*built.notes, loose))
    return built


def _require_possible(robot: Robot) -> None:
    """Refuse robots whose wheels plain MuJoCo cannot model."""
    drive = robot.drive
    if drive.leans:
        raise RpctlError(
            f"{robot.name} leans on two wheels and falls without a law, but export verifies a file "
            "by letting the robot stand and roll without one; simulate it with `rpctl track "
            "--plant contact`, verify it with `rpctl verify --contact`"
        )
    if not drive.wheels:
        raise RpctlError(
            f"{robot.name} has no wheels; MuJoCo can read the URDF of a fixed base directly"
        )
    rolling = has_rollers(robot) or drive.type == "skid-steer"
    sliding = [wheel.joint for wheel in drive.wheels if wheel.slides and not rolling]
    if sliding:
        raise RpctlError(
            f"{robot.name}: {', '.join(sliding)} may slide sideways, but friction in MuJoCo is the "
            "same in all directions; lock the joints that carry them, or declare another drive "
            "with --drive"
        )


@dataclass(frozen=True)
class MjcfExport:
    """An exported file, or why there is none.

    Attributes:
        path: The file.
        written: Whether the file was written: every row passed.
        checks: The comparisons.
        skipped: Comparisons that could not be made, with reasons.
        notes: Sentences on what was assumed, changed or left out.
        digest: Digest of the certificate in the file.
        meshes: Mesh files beside it.
        verified: The certificate of the equations.
    """

    path: Path
    written: bool
    checks: tuple[Check, ...]
    skipped: tuple[Skipped, ...]
    notes: tuple[str, ...]
    digest: str
    meshes: tuple[Path, ...]
    verified: Certificate = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return {
            "path": str(self.path),
            "written": self.written,
            "digest": self.digest,
            "checks": [check.to_dict() for check in self.checks],
            "skipped": [asdict(each) for each in self.skipped],
            "notes": list(self.notes),
            "meshes": [str(mesh) for mesh in self.meshes],
            "verified": self.verified.to_dict(),
        }


def write_mjcf(
    robot: Robot,
    path: Path,
    friction: float,
    settings: ContactSettings,
    meshes: bool,
    facts: Mapping[str, Any],
) -> MjcfExport:
    """Write a robot as MJCF if the file, read back by MuJoCo, agrees with the reduced model.

    ``facts`` say how to load the robot again; see :func:`rpctl.simulation.mjcf_file.export_mjcf`.
    """
    require_writable(path)
    verified = verify(robot, VERIFIED_SAMPLES)
    drawn = draw(robot, meshes)
    built = prepare(robot, settings, friction, hidden=bool(drawn.parts))
    root, model = body_name(robot.description.root), built.compile()
    sections = _sections(robot, model, root, drawn)
    bare = to_bytes(_document(built.spec, drawn, sections, path))
    file = parse_mjcf(bare, path)
    witness = take_witness(robot, root, settings.losses)
    rolling = robot if settings.losses else without_losses(robot)
    trial = run_on_ground(rolling, _compiled(bare, drawn, path), root)
    compared = compare_with_witness(file.model, witness)
    nearest = next((c for c in verified.checks if not c.passed), verified.worst)
    proven = replace(nearest, name=f"rpctl verify: {nearest.name}")
    # Only the keyframe may differ between file and model; it is added to the file.
    found = compare_tables(tabulate(built.compile()), file.table)
    faults = [edit.sentence for edit in found.edits if edit.matters and edit.kind != "key"]
    residual = float("inf") if faults else found.largest
    numbers_kept = Check("every number", READ_BACK, residual, 0.0, entry="; ".join(faults[:3]))
    checks = (proven, numbers_kept, *compared, *trial.checks)
    given = {"settings": {"friction": friction, **asdict(settings)}, "facts": dict(facts)}
    certificate = _certificate(robot, file, witness, checks, verified, given)
    sections["custom"] = certificate.parts(HOW)
    written = all(check.passed for check in checks)
    data = to_bytes(_document(built.spec, drawn, sections, path))
    files = _put(path, data, drawn) if written else ()
    notes = (*built.repairs, *built.notes, *drawn.notes, *trial.notes)
    return MjcfExport(
        path, written, checks, trial.skipped, notes, certificate.digest, files, verified
    )


def _certificate(
    robot: Robot,
    file: StrictMjcf,
    witness: Witness,
    checks: tuple[Check, ...],
    verified: Certificate,
    given: Mapping[str, Any],
) -> MjcfCertificate:
    """Return the certificate; ``given`` holds the settings and how to load the robot."""
    text = json.dumps(verified.to_dict(), sort_keys=True)
    return MjcfCertificate(
        robot=robot.name,
        source=robot.source,
        urdf=robot.description.sha256,
        model=model_digest(robot),
        made_with={"rpctl": __version__, "mujoco": version("mujoco")},
        checks=tuple({"name": c.name, "against": c.against, "limit": c.limit} for c in checks),
        verified={
            "sha256": hashlib.sha256(text.encode()).hexdigest(),
            "samples": verified.samples,
            "seed": verified.seed,
            "passed": verified.passed,
        },
        table=file.table,
        witness=witness,
        **given,
    )


def _sections(robot: Robot, model: Any, root: str, drawn: Drawn) -> dict[str, list[Any]]:
    """Return what the file has besides the model: visuals, sensors, and the keyframe."""
    home, hold = settle(robot, model, root)
    controls = np.zeros(model.nu)
    controls[[model.actuator(name).id for name in robot.actuators]] = hold
    key = {"name": HOME, "qpos": numbers(home), "ctrl": numbers(controls)}
    return {
        "visual": [
            etree.Element("headlight", {"ambient": "0.3 0.3 0.3", "diffuse": "0.5 0.5 0.5"})
        ],
        "asset": list(drawn.assets),
        "sensor": sensor_parts(robot, root),
        "keyframe": [etree.Element("key", key)],
    }


def _document(spec: Any, drawn: Drawn, sections: dict[str, list[Any]], path: Path) -> Any:
    """Return the root element of the file."""
    light = etree.Element(
        "light", {"name": "sun", "pos": "0 0 4", "dir": "0 0 -1", "directional": "true"}
    )
    parts = {**drawn.parts, "world": [light]}
    comment = (
        f" Written by rpctl {__version__}. Units: m, kg, s, rad, N. Controls are efforts at "
        f"the joints (N m, N). `rpctl check {path.name.replace('--', '- -')}` proves it again. "
    )
    root = write_model(spec, parts, sections, comment)
    if drawn.files:
        root.find("compiler").set("meshdir", mesh_folder(path).name)
    return root


def mesh_folder(path: Path) -> Path:
    """Return the folder of a file's meshes."""
    return path.with_name(f"{path.stem}{MESH_SUFFIX}")


def _compiled(data: bytes, drawn: Drawn, path: Path) -> Any:
    """Return ``MjModel`` of the whole file with its meshes, as a user's MuJoCo reads them.

    Raises:
        RpctlError: MuJoCo refuses it.
    """
    with tempfile.TemporaryDirectory(prefix="rpctl-") as folder:
        staged = Path(folder) / (path.name or "robot.xml")
        staged.write_bytes(data)
        if drawn.files:
            mesh_folder(staged).mkdir()
        for name, content in drawn.files.items():
            (mesh_folder(staged) / name).write_bytes(content)
        try:
            return mujoco_library().MjModel.from_xml_path(str(staged))
        except ValueError as error:
            reason = " ".join(str(error).replace(str(folder), "").split())
            raise RpctlError(
                f"MuJoCo refuses the visual meshes of the robot: {reason}; leave meshes out with "
                "--no-meshes, or correct the mesh"
            ) from None


def _put(path: Path, data: bytes, drawn: Drawn) -> tuple[Path, ...]:
    """Write the meshes, then the file; equal names of meshes mean equal content."""
    folder = mesh_folder(path)
    if drawn.files:
        make_folder(folder)
    for name, content in drawn.files.items():
        write_atomically(folder / name, content, follow_links=False)
    write_atomically(path, data)
    return tuple(folder / name for name in drawn.files)
