"""What a machine that builds people's robots reads: JUnit's XML of a proof, SARIF of a file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from lxml import etree

from rpctl import __version__
from rpctl.equivalence.verify import Certificate
from rpctl.errors import DescriptionError, Finding, RpctlError, printable
from rpctl.files.writing import require_writable, to_json, write_atomically

LEVELS = {"error": "error", "warning": "warning", "info": "note"}  # of SARIF, by severity
SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
COUNTED = {"failures": "failure", "errors": "error", "skipped": "skipped"}  # of JUnit


def junit(certificate: Certificate) -> bytes:
    """Return a certificate as JUnit's XML: a test case for each comparison."""
    suite = etree.Element("testsuite", name=printable(f"rpctl verify {certificate.robot}"))
    trials = [trial.checks for trial in (certificate.contact,) if trial is not None]
    for check in (*certificate.checks, *(check for checks in trials for check in checks)):
        case = _case(suite, check.against, check.name)
        if not check.passed:
            said = (
                f"residual {check.residual:.3g} exceeds the limit {check.limit:.3g}; {check.entry}"
            )
            etree.SubElement(case, "failure", message=printable(said))
    for onset in certificate.onset.onsets if certificate.onset else ():
        case = _case(suite, "onset", f"{onset.manoeuvre} until it {onset.ending}")
        if not onset.passed:
            said = f"predicted at {onset.equal:.3g}, measured at {onset.measured:.3g} {onset.unit}"
            etree.SubElement(case, "failure", message=said)
    for each in certificate.skipped:
        etree.SubElement(_case(suite, each.against, each.name), "skipped",
                         message=printable(each.note))  # fmt: skip
    return _counted(suite)


def junit_error(robot: str, error: RpctlError) -> bytes:
    """Return JUnit's XML of a robot that could not be verified at all."""
    suite = etree.Element("testsuite", name=printable(f"rpctl verify {robot}"))
    said = printable(str(error), keep="\n")
    etree.SubElement(_case(suite, "rpctl", "load"), "error", message=said)
    return _counted(suite)


def _case(suite: etree._Element, group: str, name: str) -> etree._Element:
    return etree.SubElement(suite, "testcase", classname=printable(group), name=printable(name))


def _counted(suite: etree._Element) -> bytes:
    suite.set("tests", str(len(suite)))
    for name, kind in COUNTED.items():
        suite.set(name, str(len(suite.findall(f"testcase/{kind}"))))
    root = etree.Element("testsuites")
    root.append(suite)
    return bytes(etree.tostring(root, xml_declaration=True, encoding="utf-8", pretty_print=True))


def sarif(path: Path | str, findings: Iterable[Finding]) -> bytes:
    """Return what was found in a file as SARIF 2.1.0, its place relative to the working folder."""
    place = Path(os.path.relpath(path)).as_posix()
    if place.startswith(".."):
        place = Path(path).absolute().as_uri()
    results = [
        {
            "ruleId": f"urdf-{each.severity}",
            "level": LEVELS[each.severity],
            "message": {"text": each.message},
            "locations": [
                {
                    "physicalLocation": {
                        "artifactLocation": {"uri": place},
                        "region": {"startLine": each.line or 1},
                    }
                }
            ],
        }
        for each in findings
    ]
    rules = [{"id": f"urdf-{severity}"} for severity in LEVELS]
    driver = {"name": "rpctl", "version": __version__, "rules": rules}
    document = {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "results": results}],
    }
    return (to_json(document) + "\n").encode()


def findings_of(error: RpctlError) -> tuple[Finding, ...]:
    """Return what an error says of a robot's file."""
    if isinstance(error, DescriptionError):
        return error.findings
    return (Finding("error", None, str(error)),)


@contextmanager
def told(file: Path | None, write: Callable[[RpctlError], bytes]) -> Iterator[None]:
    """Write a report of what goes wrong in the ``with`` block, if there is a file for it."""
    if file is not None:
        require_writable(file)
    try:
        yield
    except RpctlError as error:
        if file is not None:
            write_atomically(file, write(error))
        raise
