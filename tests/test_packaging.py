"""What is built and handed out: the wheel's bill of materials, its licences, its description."""

from __future__ import annotations

import hashlib
import json
import re
import sys
import tarfile
import zipfile
from collections.abc import Iterator
from email.message import Message
from email.parser import Parser
from pathlib import Path
from typing import Any

import pytest

import rpctl
from rpctl.files import caps
from rpctl.view.pages import third_party
from rpctl.view.serve import server
from tests.package_statements import modules

ROOT = Path(__file__).parents[1]
PACKAGES = {  # what is imported under another name than it is installed by
    "pinocchio": "pin",
    "PIL": "pillow",
    "umsgpack": "u-msgpack-python",
    "yaml": "pyyaml",
    "tomli_w": "tomli-w",
    "fast_simplification": "fast-simplification",
}
NEVER_IMPORTED = {"example-robot-data", "meshcat"}  # their files are read
BY_NAME = {"yourdfpy", "trimesh", "fast_simplification"}  # by rpctl.libraries, or when confined


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    builders = pytest.importorskip("hatchling.builders.wheel")
    pytest.importorskip("cyclonedx")
    (file,) = builders.WheelBuilder(str(ROOT)).build(
        directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"]
    )
    with zipfile.ZipFile(file) as archive:
        yield archive


def read(wheel: zipfile.ZipFile, name: str) -> str:
    return wheel.read(f"rpctl-{rpctl.__version__}.dist-info/{name}").decode()


@pytest.fixture(scope="module")
def metadata(wheel: zipfile.ZipFile) -> Message:
    return Parser().parsestr(read(wheel, "METADATA"))


@pytest.fixture(scope="module")
def bill(wheel: zipfile.ZipFile) -> dict[str, Any]:
    return dict(json.loads(read(wheel, "sboms/rpctl.cdx.json")))


def requirements(metadata: Message) -> dict[str, str]:
    """Return the ranges of what the wheel asks for always, by package."""
    lines = [line for line in metadata.get_all("Requires-Dist", []) if "extra ==" not in line]
    parts = (re.match(r"([\w.-]+)([^;]*)", line) for line in lines)
    return {part[1]: part[2] for part in parts if part is not None}


@pytest.mark.slow
def test_the_bill_of_materials_is_valid(wheel: zipfile.ZipFile) -> None:
    validators = pytest.importorskip("cyclonedx.validation.json")
    schema = pytest.importorskip("cyclonedx.schema").SchemaVersion.V1_6
    text = read(wheel, "sboms/rpctl.cdx.json")
    assert validators.JsonStrictValidator(schema).validate_str(text) is None
    assert validators.JsonStrictValidator(schema).validate_str(text.replace('"library"', '"x"'))


def test_the_bill_names_every_dependency_with_its_range(
    bill: dict[str, Any], metadata: Message
) -> None:
    parts = {part["name"]: part for part in bill["components"]}
    for name, versions in requirements(metadata).items():
        part = parts.pop(name)
        said = {each["value"] for each in part["properties"] if each["name"] == "rpctl:range"}
        assert said == {versions}, name
        assert part["scope"] == "required"
        assert part["purl"] == f"pkg:pypi/{name}"
    optional = {"av", "distributed", "drake", "mujoco", "playwright", "pyarrow", "pybullet"}
    optional |= {"robot-descriptions", "salib", "sympy"}
    assert set(parts) == {"uPlot"} | optional
    assert {parts[name]["scope"] for name in optional} == {"optional"}
    own = bill["metadata"]["component"]
    assert (own["name"], own["version"]) == ("rpctl", rpctl.__version__)
    (links,) = (each for each in bill["dependencies"] if each["ref"] == own["bom-ref"])
    assert set(links["dependsOn"]) == {part["bom-ref"] for part in bill["components"]}


def test_the_bill_names_every_bundled_file_as_the_wheel_has_it(
    bill: dict[str, Any], wheel: zipfile.ZipFile
) -> None:
    (uplot,) = (part for part in bill["components"] if part["name"] == "uPlot")
    assert f"uPlot {uplot['version']}" == third_party.UPLOT
    assert uplot["licenses"] == [{"license": {"id": "MIT"}}]
    hashes = {each["name"]: each["hashes"][0]["content"] for each in uplot["components"]}
    bundled = {name for name in wheel.namelist() if re.match("rpctl/.*/assets/[^/]+/", name)}
    assert set(hashes) == bundled
    for name, digest in hashes.items():
        assert digest == hashlib.sha256(wheel.read(name)).hexdigest()
    script = f"rpctl/view/assets/uplot/{third_party.UPLOT_SCRIPT}"
    assert hashes[script] == third_party.SHA256[third_party.UPLOT_SCRIPT]


def test_the_wheel_has_every_template(wheel: zipfile.ZipFile) -> None:
    templates = {each.relative_to(ROOT).as_posix() for each in ROOT.glob("rpctl/**/*.jinja")}
    assert "rpctl/derive/templates/ros2_control/src/controller.cpp.jinja" in templates
    assert templates <= set(wheel.namelist())


@pytest.mark.slow
def test_a_wheel_can_be_built_from_the_source_archive(tmp_path: Path) -> None:
    """All that the build reads is in it, and what its documents lead to."""
    builders = pytest.importorskip("hatchling.builders.sdist")
    (file,) = builders.SdistBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    with tarfile.open(file) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    hooks = {f"build_hooks/{name}.py" for name in ("readme", "sbom")}
    documents = {f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING", "SECURITY")}
    assert {"LICENSE", "pyproject.toml", "Makefile", *hooks, *documents} <= names
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\((?!https?://|#)([^)]+)\)", readme)) <= names


def test_the_wheel_carries_the_licences_of_what_is_in_it(
    wheel: zipfile.ZipFile, metadata: Message
) -> None:
    files = metadata.get_all("License-File", [])
    texts = [read(wheel, f"licenses/{name}") for name in files]
    assert metadata["License-Expression"] == "BSD-2-Clause AND MIT"
    assert any(text.startswith("BSD 2-Clause License") for text in texts)
    assert any("Leon Sorokin" in text for text in texts)


def test_every_dependency_has_a_lower_and_an_upper_bound(metadata: Message) -> None:
    lines = metadata.get_all("Requires-Dist", [])
    assert len(lines) > 20
    for line in lines:
        assert ">=" in line.partition(";")[0], line
        assert "<" in line.partition(";")[0], line


def test_the_table_of_dependencies_names_each(metadata: Message) -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?`) \| .* \| \d+ \|$", text, flags=re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([\w-]+)`", row)}
    assert named == {*requirements(metadata), "tomli"}
    extras = {
        name
        for name in metadata.get_all("Provides-Extra", [])
        if name not in ("dev", "docs", "test")
    }
    listed = text.partition("is an extra: ")[2].partition(".\n")[0]
    assert set(re.findall(r"`([\w-]+)`", listed)) == extras


def test_what_is_imported_is_asked_for(metadata: Message) -> None:
    """A package that only comes along with another one leaves when that one drops it."""
    lines = [str(line) for line in metadata.get_all("Requires-Dist", [])]
    asked = {re.split(r"[\[<>=; ]", line)[0].replace("-", "_").lower() for line in lines}
    found = set()
    for module in modules():
        found |= {name.partition(".")[0] for name in module.imports}
        found |= {of.partition(".")[0] for of, _ in module.names}
    foreign = found - sys.stdlib_module_names - {"rpctl", "tomllib", "IPython", "pandas"}
    packages = {PACKAGES.get(name, name).replace("-", "_").lower() for name in foreign}
    assert packages <= asked, packages - asked
    always = {name.replace("-", "_") for name in set(requirements(metadata)) - NEVER_IMPORTED}
    assert always <= packages | BY_NAME


README = "![A robot](demos/a.png) [words](CONTRIBUTING.md) [site](https://x.example/y) [up](#top)"


def test_what_the_threat_model_names_is_there() -> None:
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    named = set(re.findall(r"\bMAX_\w+", text))
    assert len(named) > 10
    assert not [name for name in named if not isinstance(getattr(caps, name, None), int)]
    files = re.findall(r"`(rpctl/[\w/]+\.py)`", text)
    assert files
    assert all((ROOT / file).is_file() for file in files)
    assert f"{8 * server.TOKEN_BYTES}\nbits" in text
