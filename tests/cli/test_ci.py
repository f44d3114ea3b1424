"""What other machines read: SARIF of a file, JUnit of a proof, and ``rpctl doctor``."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import yaml
from lxml import etree
from typer.testing import CliRunner

import rpctl
from rpctl import Robot
from rpctl.cli import ci
from rpctl.cli.app import app
from tests.description.corpus import BASE

ROOT = Path(__file__).parents[2]
LIMIT = '<limit lower="-2" upper="2" effort="9" velocity="3"/>'


def invoke(*words: str) -> int:
    return CliRunner().invoke(app, words).exit_code


def results(file: Path) -> list[dict[str, Any]]:
    (run,) = json.loads(file.read_text())["runs"]
    ids = {rule["id"] for rule in run["tool"]["driver"]["rules"]}
    assert {each["ruleId"] for each in run["results"]} <= ids
    return list(run["results"])


@pytest.mark.parametrize(
    ("text", "strict", "code", "level"),
    [
        (BASE, False, 0, None),
        (BASE.replace(LIMIT, LIMIT.replace("2", "180")), False, 0, "warning"),
        (BASE.replace(LIMIT, LIMIT.replace("2", "180")), True, 2, "error"),
        (BASE.replace('upper="2"', 'upper="two"'), False, 2, "error"),
    ],
)
def test_sarif_has_each_finding_at_its_line(
    text: str, strict: bool, code: int, level: str | None, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("robot.urdf").write_text(text)
    words = ["inspect", "robot.urdf", "--sarif", "out.sarif", *["--strict"] * strict]
    assert invoke(*words) == code
    found = [each for each in results(Path("out.sarif")) if each["level"] != "note"]
    grave = [each for each in found if "limit" in each["message"]["text"]]
    assert [each["level"] for each in grave] == ([level] if level else [])
    for each in grave:
        place = each["locations"][0]["physicalLocation"]
        line = text[: text.index("<limit ")].count("\n") + 1
        assert place["artifactLocation"]["uri"] == "robot.urdf"
        assert place["region"]["startLine"] == line


def test_junit_has_a_case_for_each_comparison(paper: Robot) -> None:
    certificate = rpctl.verify(paper, samples=1, engines=())
    (suite,) = etree.fromstring(ci.junit(certificate))
    assert suite.get("tests") == str(len(certificate.checks) + len(certificate.skipped))
    assert (suite.get("failures"), suite.get("skipped")) == ("0", str(len(certificate.skipped)))
    first, *rest = certificate.checks
    broken = replace(certificate, checks=(replace(first, limit=-1.0, entry="a <b>"), *rest))
    (suite,) = etree.fromstring(ci.junit(broken))
    assert suite.get("failures") == "1"
    assert suite[0][0].get("message").endswith("; a <b>")


def test_junit_of_a_file_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    file, out = tmp_path / "robot.urdf", tmp_path / "out.xml"
    file.write_text("<robot")
    assert invoke("verify", str(file), "--junit", str(out)) == 2
    (suite,) = etree.fromstring(out.read_bytes())
    assert suite.get("errors") == "1"
    assert "the file is truncated" in suite[0][0].get("message")


def test_doctor_tells_versions_and_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    found = json.loads(CliRunner().invoke(app, ["doctor", "--json"]).stdout)
    assert found["rpctl"] == rpctl.__version__
    assert found["core"]["numpy"] == metadata.version("numpy")
    assert "tomli-w" in found["core"]
    assert found["missing"] == []
    assert set(found["extras"]["film"]) == {"playwright", "av"}
    assert not {"ruff", "pytest", "sphinx"} & {
        n for group in found["extras"].values() for n in group
    }

    def version(name: str) -> str:
        if name in ("casadi", "sympy"):
            raise metadata.PackageNotFoundError
        return "1.0"

    monkeypatch.setattr(metadata, "version", version)
    shown = CliRunner().invoke(app, ["doctor"])
    assert shown.exit_code == 1
    assert "missing casadi" in shown.output
    assert "no sympy" in shown.output and "pip install 'sympy<" in shown.output
    assert "missing casadi: pip install 'casadi<" in shown.output


def test_files_of_the_repository_say_what_the_code_says() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == rpctl.__version__
    folder = ROOT / ".github"
    action = yaml.safe_load((folder / "actions/check-urdf/action.yml").read_text())
    commands = [step["run"] for step in action["runs"]["steps"]]
    for name, options in (("inspect", ("--strict", "--sarif")), ("verify", ("--junit",))):
        (line,) = (each for each in commands if each.startswith(f"rpctl {name} "))
        assert all(option in line for option in options)
    form = yaml.safe_load((folder / "ISSUE_TEMPLATE/fault.yml").read_text())
    assert any("rpctl doctor" in str(part["attributes"]["label"]) for part in form["body"])
