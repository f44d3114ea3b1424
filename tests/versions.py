"""The range of versions that rpctl is tested with: ``make versions``.

A source archive is built, and a wheel from it. For every Python that this machine has, an
environment with the lowest versions that ``pyproject.toml`` allows, and one with the newest, takes
the wheel, runs commands away from the checkout as a user does, and then the tests that touch what
rpctl depends on. Pythons that are not here are named and left out.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import uv

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.10", "3.11", "3.12", "3.13")
RESOLUTIONS = {"lowest": "lowest-direct", "latest": "highest"}  # direct: what pyproject.toml names
EXTRAS = ("derive",)
TOOLS = ("pytest", "pytest-timeout", "hypothesis")  # the newest ones: they are not what is tested
COMMANDS = (
    "--version",
    "doctor",
    "robots",
    "inspect paper",
    "verify mixed_chain --samples 5",
    "track paper --duration 1 --out run",
)
SMOKE = (  # at least one file for each dependency, and what broke with one of them before
    "tests/cli/test_app.py",
    "tests/control/horizon/test_condensed.py",
    "tests/control/test_box_least_squares.py",
    "tests/derive/test_closed_form.py",
    "tests/description/test_density.py",
    "tests/description/xacro/test_expansion.py",
    "tests/description/meshes/test_mesh_checks.py",
    "tests/description/meshes/test_meshes.py",
    "tests/drive/test_vendor.py",
    "tests/dynamics/test_reduced.py",
    "tests/equivalence/test_certificate.py",
    "tests/files/test_toml.py",
    "tests/reference/test_motion.py",
    "tests/robot/test_catalog.py",
    "tests/simulation/test_config.py",
    "tests/simulation/run/test_run.py",
    "tests/view/pages/test_export.py",
    "tests/view/pages/test_report.py",
    "tests/view/pages/test_third_party.py",
    "tests/view/plots/test_plots.py",
)


def interpreter(version: str) -> str | None:
    """Return the path of a Python of a version that starts, or None.

    One that pyenv has but was not told to use is found, too: its stand-in on PATH only complains.
    """
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions")
    found = shutil.which(f"python{version}")
    installed = sorted(pyenv.glob(f"{version}.*/bin/python"), reverse=True)
    for path in ([found] if found else []) + [str(each) for each in installed]:
        if subprocess.run([path, "-c", ""], capture_output=True, check=False).returncode == 0:
            return path
    return None


def run_uv(*words: str) -> str:
    """Run uv, and return what it prints; a failure ends this command with uv's words."""
    done = subprocess.run([uv.find_uv_bin(), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"uv {' '.join(words)} failed:\n{done.stderr}")
    return done.stdout


def install(python: str, resolution: str, wheel: Path, folder: Path) -> tuple[Path, dict[str, str]]:
    """Make an environment of the wheel; returns its Python, and the version of every package."""
    run_uv("venv", "--quiet", "--python", python, str(folder))
    path = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    # Wheels only: what has to be compiled here says nothing of the versions.
    pip = ("pip", "install", "--quiet", "--python", str(path), "--only-binary", ":all:")
    extras = [word for name in EXTRAS for word in ("--extra", name)]
    how = ("--resolution", RESOLUTIONS[resolution])
    run_uv(*pip, *how, "--requirement", str(ROOT / "pyproject.toml"), *extras)
    run_uv(*pip, "--no-deps", str(wheel))
    listed = run_uv("pip", "freeze", "--python", str(path))
    run_uv(*pip, *TOOLS)
    lines = (line.split("==", 1) for line in listed.splitlines() if "==" in line)
    return path, dict(lines)


def build(folder: Path) -> Path:
    """Build the source archive and, from it, the wheel; return the wheel's path."""
    run_uv("build", "--quiet", "--out-dir", str(folder), str(ROOT))
    (wheel,) = folder.glob("*.whl")
    return wheel


def used(python: Path, folder: Path) -> bool:
    """Run the installed commands in a folder with nothing in it; return whether they passed."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"RPCTL_CACHE_DIR": str(folder / "cache"), "OMP_NUM_THREADS": "1"}
    folder.mkdir()
    for words in COMMANDS:
        command, began = [str(python.with_name("rpctl")), *words.split()], time.perf_counter()
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        print(f"rpctl {words}: {time.perf_counter() - began:.1f} s", flush=True)
        if done.returncode:
            print(done.stdout, done.stderr, sep="\n", flush=True)
            return False
    return True


def smoke(python: Path, tests: tuple[str, ...]) -> bool:
    """Run tests of this checkout with an environment's Python; return whether they passed."""
    command = [str(python), "-m", "pytest", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode == 0


def declared() -> Iterator[str]:
    """Yield the names of the packages that ``pyproject.toml`` names as dependencies."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    block = text.partition("\ndependencies = [")[2].partition("\n]")[0]
    for name in re.findall(r'^\s*"([\w.-]+)', block, flags=re.MULTILINE):
        yield name.lower()


def main() -> int:
    """Test what was asked for; returns 1 if a combination failed, or if there was none."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", choices=PYTHONS, action="append", help="only these")
    parser.add_argument("--resolution", choices=RESOLUTIONS, action="append", help="only these")
    parser.add_argument("tests", nargs="*", help="other tests than the usual ones")
    options = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory(prefix="rpctl-versions-") as scratch:
        wheel = build(Path(scratch, "dist"))
        print(f"{wheel.name}, built from the source archive", flush=True)
        for version in options.python or PYTHONS:
            python = interpreter(version)
            if python is None:
                print(f"Python {version}: left out, it is not on this machine", flush=True)
                continue
            for resolution in options.resolution or RESOLUTIONS:
                name = f"Python {version}, {resolution}"
                folder = Path(scratch, name)
                path, found = install(python, resolution, wheel, folder / "env")
                direct = [f"{each} {found[each]}" for each in declared() if each in found]
                print(f"\n== {name}: {', '.join(direct)}", flush=True)
                passed = used(path, folder / "empty")
                results[name] = smoke(path, tuple(options.tests) or SMOKE) and passed
                shutil.rmtree(folder)
    print("\n" + "\n".join(f"{name}: {'passed' if r else 'FAILED'}" for name, r in results.items()))
    return 0 if results and all(results.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
