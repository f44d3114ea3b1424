"""What a process computes with, and where two of them differ."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("rpctl", "numpy", "pin", "casadi", "llvmlite")  # that results depend on
PYTHON, CODE = "python", "rpctl's code"
ABSENT = "none"
DIGITS = 12  # of a digest: enough to tell two checkouts apart


@lru_cache(maxsize=1)
def installed() -> dict[str, str]:
    """Return what this process computes with, by name; as it was when it was first asked."""
    return {
        PYTHON: minor(".".join(map(str, sys.version_info))),
        **{package: _version(package) for package in PACKAGES},
        CODE: code_digest(),
    }


def minor(python: str) -> str:
    """Return the minor version of Python, ``3.11`` of ``3.11.2.final.0``."""
    return ".".join(python.split(".")[:2])


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ABSENT


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Return a digest of rpctl's modules: two checkouts of one version may differ."""
    package, digest = Path(__file__).parents[1], sha256()
    for path in sorted(package.rglob("*.py")):
        data = path.read_bytes()
        digest.update(f"{path.relative_to(package).as_posix()} {len(data)} ".encode())
        digest.update(data)
    return digest.hexdigest()[:DIGITS]


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Return what another process has otherwise, each as ``numpy 2.3.1, here 2.4.6``.

    Only what is named on both sides is compared.
    """
    return [
        f"{name} {there[name]}, here {mine}"
        for name, mine in here.items()
        if name in there and there[name] != mine
    ]
