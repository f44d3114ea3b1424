"""The speed table: every figure beside that of a peer in one run, as text and data.

``python -m tests.bench.table`` measures for some minutes and writes ``speed.md`` and
``speed.json``; ``--quick`` measures less and puts the rest in proportion, ``--only NAME`` measures
one section. ``--readme`` rewrites the README's table from ``speed.json`` and measures
nothing. Run it on a machine that does nothing else, with ``OMP_NUM_THREADS=1``, as ``make bench``
does.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.metadata import distributions
from pathlib import Path

from tests.bench.rows import Section, markdown

SECTIONS = ("forward", "controller", "closed_loop", "rollouts", "horizon", "startup")
PEERS = ("pin", "casadi", "numpy", "mujoco")  # packages
OUT = Path("runs/bench")


def measured(names: Sequence[str], quick: bool) -> Iterator[Section]:
    """Yield the sections of some names; nothing that an earlier run compiled is found.

    Args:
        names: Modules of ``tests.bench.sections``.
        quick: Whether to measure less.
    """
    with tempfile.TemporaryDirectory() as folder:
        os.environ["RPCTL_CACHE_DIR"] = folder
        for name in names:
            began = time.perf_counter()
            yield import_module(f"tests.bench.sections.{name}").section(quick)
            print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr)


def circumstances(quick: bool, loads: Sequence[float]) -> str:
    """Return what was measured with, in a sentence or two.

    Args:
        quick: Whether less was measured.
        loads: What waited for a processor meanwhile, this process included, over a minute each.
    """
    installed = {each.metadata["Name"]: each.version for each in distributions()}
    packages = [f"{name} {installed[name]}" for name in PEERS if name in installed]
    how = "quick" if quick else "in full"
    return (
        f"Measured {how} on {_processor()}, Python {platform.python_version()}, "
        f"{', '.join(packages)}, load {min(loads):.1f} to {max(loads):.1f}. Processor time of one "
        "core, the least of several, unless said; compare ratios, which are of one run, and not "
        "times of different machines. A ratio is how many times better than the peer.\n"
    )


def _processor() -> str:
    """Return the processor's name; the family and model tell what a hypervisor's name does not."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    found = {name.strip(): value.strip() for name, _, value in (x.partition(":") for x in lines)}
    if "model name" not in found:
        return platform.processor() or platform.machine()
    kind = f"family {found.get('cpu family', '?')}, model {found.get('model', '?')}"
    return f"{os.cpu_count()} × {found['model name']} ({kind})"


def write(out: Path, sections: Sequence[Section], said: str) -> None:
    """Write the table as text and data.

    Args:
        out: The folder.
        sections: The table.
        said: Where and how it was measured.
    """
    out.mkdir(parents=True, exist_ok=True)
    (out / "speed.md").write_text(markdown(sections, said), encoding="utf-8")
    data = {"circumstances": said, "sections": [section.to_dict() for section in sections]}
    (out / "speed.json").write_text(json.dumps(data, indent=1, allow_nan=False), encoding="utf-8")


def read(out: Path) -> tuple[list[Section], str]:
    """Return the sections that a folder's ``speed.json`` has, and how they were measured."""
    data = json.loads((out / "speed.json").read_text(encoding="utf-8"))
    return [Section.from_dict(each) for each in data["sections"]], data["circumstances"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and write, or rewrite the README's table."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.table", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="measure less")
    parser.add_argument("--out", type=Path, default=OUT, help="the folder")
    parser.add_argument("--only", action="append", choices=SECTIONS, help="a section")
    parser.add_argument("--readme", action="store_true", help="rewrite the README's table")
    asked = parser.parse_args(arguments)
    if asked.readme:
        from tests.bench.readme_table import rewrite

        rewrite(*read(asked.out))
        return
    sections: list[Section] = []
    loads = [os.getloadavg()[0]]
    for section in measured(asked.only or SECTIONS, asked.quick):
        sections.append(section)
        loads.append(os.getloadavg()[0])
        write(
            asked.out, sections, circumstances(asked.quick, loads)
        )  # what a later one cannot undo
    print((asked.out / "speed.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
