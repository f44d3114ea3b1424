"""The command that says what a fault report needs to know: ``rpctl doctor``."""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
from collections.abc import Mapping
from importlib import metadata
from typing import Any

from rpctl import __version__
from rpctl.cli.options import JsonOption, tell
from rpctl.cli.terminal import console, escape, new_table
from rpctl.kernels.cache import MOST_BYTES, cache_folder
from rpctl.libraries import install_command, requirements
from rpctl.view.film import BROWSER_NAMES

FOR_DEVELOPERS = {"dev", "test", "docs"}
MB = 2**20


def doctor_command(as_json: JsonOption = False) -> None:
    """Show versions, cache and extras, and what is missing; exit 1 if rpctl cannot run."""
    found = diagnosis()
    tell(as_json, lambda: found, lambda: _show(found), not found["missing"])


def diagnosis() -> dict[str, Any]:
    """Return what is installed, as JSON says it; versions are None of what is not."""
    core: dict[str, str | None] = {}
    extras: dict[str, dict[str, str | None]] = {}
    for name, _, marker, extra in requirements():
        if name == "rpctl" or extra in FOR_DEVELOPERS or not _applies(marker):
            continue
        group = extras.setdefault(extra, {}) if extra else core
        group[name] = _version(name)
    folder = cache_folder() / "code"
    kept = [file.stat().st_size for file in folder.glob("*.code")] if folder.is_dir() else []
    return {
        "rpctl": __version__,
        "python": platform.python_version(),
        "executable": sys.executable,
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "browser": next(filter(None, map(shutil.which, BROWSER_NAMES)), None),
        "cache": {"folder": str(folder), "files": len(kept), "bytes": sum(kept)},
        "core": core,
        "extras": extras,
        "missing": [name for name, version in core.items() if version is None],
    }


def _applies(marker: str) -> bool:
    """Return whether a package is needed on this Python; only ``python_version <`` counts."""
    older = re.search(r"python_version < ['\"]3\.(\d+)", marker)
    return older is None or sys.version_info < (3, int(older[1]))


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _show(found: Mapping[str, Any]) -> None:
    out, table, cache = console(), new_table("what", "found"), found["cache"]
    for name in ("rpctl", "python", "executable", "platform", "processors"):
        table.add_row(name, escape(str(found[name])))
    browser = found["browser"] or "none installed; run `playwright install chromium`"
    table.add_row("browser, for films", escape(browser))
    size = f"{cache['files']} files, {cache['bytes'] / MB:.0f} of {MOST_BYTES // MB} MB"
    table.add_row("cache", escape(f"{cache['folder']}: {size}"))
    for group, parts in ({"core": found["core"]} | found["extras"]).items():
        have = [f"{name} {version}" for name, version in parts.items() if version]
        lacks = [name for name, version in parts.items() if version is None]
        told = ", ".join([*have, *(f"[yellow]no {name}[/]" for name in lacks)])
        command = f"\n[dim]{escape(install_command(group))}[/]"
        advice = command if lacks and group != "core" else ""
        table.add_row(group, told + advice)
    out.print(table)
    for name in found["missing"]:
        out.print(f"[bold red]missing[/] {name}: {escape(install_command(name))}")
