"""The bill of materials of the wheel: what is bundled, and what is asked for beside it."""

from __future__ import annotations

import hashlib
import tempfile
import uuid
from collections.abc import Iterator, Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from cyclonedx.model import HashAlgorithm, HashType, Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentScope, ComponentType
from cyclonedx.model.license import DisjunctiveLicense, LicenseExpression
from cyclonedx.output.json import JsonV1Dot6
from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.builders.utils import get_reproducible_timestamp
from packageurl import PackageURL
from packaging.requirements import Requirement

DEVELOPMENT = ("dev", "docs", "test")  # extras that no user of the wheel takes
RANGE, MARKER, EXTRA = "rpctl:range", "rpctl:marker", "rpctl:extra"  # names of properties


class SbomHook(BuildHookInterface[Any]):
    """Puts ``rpctl.cdx.json`` into ``.dist-info/sboms`` of the wheel [PEP 770].

    The bundled works of others are told in ``pyproject.toml`` beside the hook: name, version,
    licence, and the files that the wheel carries of each.
    """

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the bill; an editable install has none."""
        if version == "editable":
            return
        self._folder = tempfile.TemporaryDirectory()
        file = Path(self._folder.name, "rpctl.cdx.json")
        project = self.metadata.core
        extras = project.optional_dependencies.items()
        asked = {name: each for name, each in extras if name not in DEVELOPMENT}
        bill = build_bill(
            (project.name, self.metadata.version, project.license_expression),
            {"": project.dependencies, **asked},
            self.config["bundled"],
            Path(self.root),
        )
        file.write_text(JsonV1Dot6(bill).output_as_string(indent=2) + "\n", encoding="utf-8")
        build_data["sbom_files"].append(str(file))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the file that the wheel was given."""
        if version != "editable":
            self._folder.cleanup()


def build_bill(
    project: tuple[str, str, str],
    requirements: Mapping[str, list[str]],
    bundled: list[dict[str, Any]],
    root: Path,
) -> Bom:
    """Return the bill of materials, the same for the same files.

    Args:
        project: Name, version and licence of the project.
        requirements: What is asked for, by extra; "" for what is always asked for.
        bundled: The works of others that the wheel carries: name, version, licence, and files
            below the root.
        root: The folder of the project.
    """
    name, version, licence = project
    own = Component(
        name=name,
        version=version,
        type=ComponentType.APPLICATION,
        bom_ref=name,
        purl=PackageURL("pypi", None, name, version),
        licenses=[LicenseExpression(licence)],
    )
    bill = Bom(serial_number=uuid.uuid5(uuid.NAMESPACE_DNS, f"{name}-{version}"))
    bill.metadata.timestamp = datetime.fromtimestamp(get_reproducible_timestamp(), timezone.utc)
    bill.metadata.component = own
    parts = [_bundled_part(each, root) for each in bundled]
    parts += _required_parts(requirements)
    bill.components.update(parts)
    bill.register_dependency(own, parts)
    return bill


def _bundled_part(work: Mapping[str, Any], root: Path) -> Component:
    """Return a work of others in the wheel, its files with their hashes."""
    files = [
        Component(
            name=path,
            type=ComponentType.FILE,
            bom_ref=path,
            hashes=[HashType(alg=HashAlgorithm.SHA_256, content=_digest(root / path))],
        )
        for path in work["files"]
    ]
    return Component(
        name=work["name"],
        version=work["version"],
        type=ComponentType.LIBRARY,
        bom_ref=f"bundled:{work['name']}",
        purl=PackageURL("npm", None, work["name"].lower(), work["version"]),
        licenses=[DisjunctiveLicense(id=work["license"])],
        components=files,
    )


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _required_parts(requirements: Mapping[str, list[str]]) -> Iterator[Component]:
    """Yield each package that is asked for once, with the range of its versions.

    It is required where it is always asked for, and optional where an extra asks for it.
    """
    asked: dict[str, list[tuple[str, Requirement]]] = {}
    for extra, lines in requirements.items():
        for requirement in map(Requirement, lines):
            asked.setdefault(requirement.name, []).append((extra, requirement))
    for name, found in asked.items():
        required = any(not extra for extra, _ in found)
        yield Component(
            name=name,
            type=ComponentType.LIBRARY,
            bom_ref=f"required:{name}",
            scope=ComponentScope.REQUIRED if required else ComponentScope.OPTIONAL,
            purl=PackageURL("pypi", None, name),
            properties=_properties(found),
        )


def _properties(found: list[tuple[str, Requirement]]) -> Iterator[Property]:
    for extra, requirement in found:
        yield Property(name=RANGE, value=str(requirement.specifier))
        if extra:
            yield Property(name=EXTRA, value=extra)
        if requirement.marker is not None:
            yield Property(name=MARKER, value=str(requirement.marker))
