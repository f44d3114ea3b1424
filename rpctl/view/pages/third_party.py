"""The scripts of others that pages carry: each known by its hash, its licence texts beside it.

A page is passed on, and its readers run what is in it: a script that rpctl was not tested with, or
that somebody changed, goes into no page.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from rpctl.errors import RpctlError
from rpctl.view.pages.page import asset

MESHCAT, UPLOT = "meshcat 0.3.2", "uPlot 1.6.32"
MESHCAT_SCRIPT = "viewer/dist/main.min.js"
MESHCAT_LICENCE = "viewer/LICENSE"
BUNDLED_LICENCES = f"{MESHCAT_SCRIPT}.THIRD_PARTY_LICENSES.json"  # of what the script bundles
UPLOT_SCRIPT = "uPlot.iife.min.js"
SHA256 = {  # of the files that pages may carry
    MESHCAT_SCRIPT: "dd07b95fb6957cf6c18ee7cf3909b6eb28214995142428171a60d76c3358211f",
    MESHCAT_LICENCE: "370b13e4ea712b2b2a6a44789325bf9c8490e1f17cbc0211ebfe1d64f10f3131",
    BUNDLED_LICENCES: "7dc776f3f61072c1f365fbb450a72a7961fd026465d4743868bcba22705969e9",
    UPLOT_SCRIPT: "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
}
PERMISSION = "Permission is hereby granted"  # how the words of the MIT licence begin


@dataclass(frozen=True)
class Licence:
    """The licence of a work of others.

    Attributes:
        work: Its name and version.
        name: Of the licence, as SPDX calls it.
        text: The whole of it.
    """

    work: str
    name: str
    text: str


def meshcat_script() -> str:
    """Return meshcat's viewer; the package is found, not imported (it would load IPython).

    Raises:
        RpctlError: It is not there, or is not the one that pages may carry.
    """
    return _meshcat_file(MESHCAT_SCRIPT)


def uplot_script() -> str:
    """Return uPlot, which draws charts.

    Raises:
        RpctlError: It was changed.
    """
    return _known(UPLOT_SCRIPT, asset(f"uplot/{UPLOT_SCRIPT}").encode(), "rpctl")


def licences(charts: bool) -> tuple[Licence, ...]:
    """Return the licences of what a page carries.

    Args:
        charts: Whether it carries uPlot, too.

    Raises:
        RpctlError: meshcat comes without them.
    """
    uplot = Licence(UPLOT, "MIT", asset("uplot/LICENSE"))
    return (*_meshcat_licences(), *((uplot,) if charts else ()))


def _meshcat_file(name: str) -> str:
    """Return a file of meshcat.

    Raises:
        RpctlError: It is not there, or is not the one that pages may carry.
    """
    found = find_spec("meshcat")
    folders = found.submodule_search_locations if found else None
    package = MESHCAT.replace(" ", "==")
    for folder in folders or ():
        file = Path(folder, name)
        if file.is_file():
            return _known(name, file.read_bytes(), package)
    raise RpctlError(f"meshcat or its {name} is missing; run: pip install '{package}'")


def _known(name: str, content: bytes, package: str) -> str:
    """Return a file that pages carry if it is the one that was looked at.

    Args:
        name: What it is called in ``SHA256``.
        content: The whole of it.
        package: What brings the right one, as pip calls it.

    Raises:
        RpctlError: It is another.
    """
    digest = hashlib.sha256(content).hexdigest()
    if digest != SHA256[name]:
        raise RpctlError(
            f"{name}: not the file that rpctl was tested with (its sha256 begins {digest[:8]}, "
            f"not {SHA256[name][:8]}) and would be in every page; run: pip install "
            f"--force-reinstall --no-deps '{package}'"
        )
    return content.decode()


def _meshcat_licences() -> Iterator[Licence]:
    """Yield the licence of meshcat's viewer, and of all that its script bundles."""
    own = _meshcat_file(MESHCAT_LICENCE)
    yield Licence(MESHCAT, "MIT", own)
    words = own[own.index(PERMISSION) :]
    for each in json.loads(_meshcat_file(BUNDLED_LICENCES)):
        # One package names the MIT licence and its author, and leaves out the words.
        text = each["licenseText"] or f"Copyright (c) {each['author']}\n\n{words}"
        yield Licence(f"{each['name']} {each['version']}", each["license"], text)
