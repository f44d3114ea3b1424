"""Pages of the reference, written from the code: commands, keys of TOML, outcomes, the Python API.

They are written anew at each build, beside the pages that people write, and are not kept.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rpctl
from rpctl.cli.app import COMMANDS, WITHOUT_JSON, load_command
from rpctl.control.registry import DYNAMIC_LAWS, KINEMATIC_LAWS
from rpctl.files.records import TYPE_LABELS, FieldType, OneOf, settings_of
from rpctl.robot.catalog import ENTRIES
from rpctl.simulation.config import LimitOverrides, RunSettings
from rpctl.simulation.plants.plant import Plant

sys.path.insert(0, str(Path(__file__).parents[2] / "demos"))
from pictures import REFERENCES

HEAD = "% Written from the code by docs/_ext/from_code.py.\n\n"


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Return a table of Markdown."""
    lines = [head, ("---",) * len(head), *rows]
    return "".join(
        f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines
    )


def commands() -> str:
    """Return the page of the command line."""
    without = " and ".join(f"`{name}` ({why})" for name, why in WITHOUT_JSON.items())
    text = (
        "# Command line\n\nEvery command answers `--help` with an example, and `--json` with its "
    )
    text += f"result as JSON on stdout and messages on stderr, except {without}.\n"
    for name, entry in COMMANDS.items():
        command = load_command(name)
        text += f"\n## rpctl {name}\n\n{command.help or entry.summary}\n\n"
        text += f"Example: `{entry.example}`\n\n"
        rows = [
            (_written(each), _metavar(each), " ".join((each.help or "").split()))
            for each in command.params
            if not getattr(each, "hidden", False)
        ]
        text += table(("option", "takes", "what it does"), rows)
    return text


def _written(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"**{parameter.name.upper()}**"
    names = [*parameter.opts, *parameter.secondary_opts]
    return ", ".join(f"`{name}`" for name in names)


def _metavar(parameter: Any) -> str:
    if getattr(parameter, "is_flag", False):
        return ""
    return f"`{parameter.metavar}`" if parameter.metavar else ""


def keys() -> str:
    """Return the page of the keys of a run's file."""
    text = (
        "# Keys of a run's file\n\n`rpctl track ROBOT --save-config FILE` writes such a file, and "
        "a JSON Schema beside it from which editors complete; `--config FILE` takes any part of "
        "it. Lengths are in m, angles in rad, times in s.\n"
    )
    for name, record in (("run", RunSettings), ("plant", Plant), ("guards", rpctl.Guards)):
        text += f"\n## [{name}]\n\n" + settings(settings_of(record))
    limits = [
        (f"`{each.name}`", "numbers by pattern of joint names")
        for each in dataclasses.fields(LimitOverrides)
    ]
    text += "\n## [limits]\n\nIn place of the URDF's.\n\n" + table(("key", "is"), limits)
    text += "\n## [output]\n\n" + settings(settings_of(rpctl.VelocityOutput))
    for kind, laws in (("kinematic", KINEMATIC_LAWS), ("dynamic", DYNAMIC_LAWS)):
        text += f"\n## [{kind}]\n\n`law` names the law; the other keys are its own.\n"
        for name, law in laws.items():
            text += f'\n### law = "{name}"\n\n' + settings(settings_of(law()))
    return text


def settings(found: dict[str, FieldType]) -> str:
    """Return a table of settings."""
    rows = [
        (
            f"`{name}`",
            _range(each),
            each.setting.unit,
            _default(each),
            " ".join(each.setting.help.split()),
        )
        for name, each in found.items()
    ]
    return table(("key", "may be", "unit", "default", "what it is"), rows)


def _range(field: FieldType) -> str:
    if isinstance(field.limit, OneOf):
        return ", ".join(f"`{word}`" for word in field.limit.words)
    if field.limit is not None and field.limit.wanted:
        return field.limit.wanted
    if field.limit is not None and abs(field.limit.high) < 1e9:
        return f"{field.limit.low:g} to {field.limit.high:g}"
    return TYPE_LABELS.get(field.type, "")


def _default(field: FieldType) -> str:
    if field.default is dataclasses.MISSING:
        return "has to be given"
    if isinstance(field.default, str | int | float):
        return f"`{field.default}`"
    return ""


def api() -> str:
    """Return the page of the Python API."""
    text = "# Python API\n\nShapes stand in brackets; everything is in SI units and radians.\n"
    for title, names in API.items():
        text += f"\n## {title}\n"
        for name in names.split():
            kind = "autoclass" if isinstance(getattr(rpctl, name), type) else "autofunction"
            members = ":members:\n" if kind == "autoclass" else ""
            text += f"\n```{{eval-rst}}\n.. {kind}:: rpctl.{name}\n"
            text += "   :members:\n" if members else ""
            text += "```\n"
    left = set(rpctl.__all__) - {name for names in API.values() for name in names.split()}
    if left:
        raise RuntimeError(f"the API's page lacks {', '.join(sorted(left))}")
    return text


API = {  # by what they are for
    "Robots": (
        "load Robot Drive Wheel with_payload CarriedLoad set_limits scale_limits scale_masses"
    ),
    "Dynamics": "ReducedDynamics linearize",
    "Proof": "verify Certificate draw_state",
    "References": "load_reference as_reference ReferenceState",
    "Laws": (
        "BaseLaw Setting UnifiedKinematic PaperKinematic Horizon EndEffector Kanayama Samson "
        "FeedbackLinearization PaperDynamic BoundedDynamic IntegralDynamic StatelessLaw "
        "Tracking Command Efforts Limit Rest Leash Approach Disc HalfPlane derive_law"
    ),
    "On a robot": (
        "Controller ControllerOutput Guards OutputGroup GroupCommand VelocityOutput SpeedLog "
        "lag_from"
    ),
    "Runs": (
        "track Config RunSettings LimitOverrides write_config Run Summary summarize write_report"
    ),
    "Plants": (
        "Plant start_plant PlantModel PlantSample Slipping ContactSettings Noise Wrench MjcfRobot "
        "export_mjcf check_mjcf"
    ),
    "Many runs": "rollout Rollouts Uniform LogUniform Normal AnyOf Fixed",
    "Errors": "RpctlError",
}


def gallery() -> str:
    """Return the gallery: the project's own robots, with their pictures and commands."""
    text = (
        "# Gallery\n\nEach kind of drive as a small robot in `urdf/`. `make pictures` draws them.\n"
    )
    for entry in (each for each in ENTRIES if each.own):
        text += f"\n## {entry.name}\n\n{entry.summary[0].upper()}{entry.summary[1:]}.\n\n"
        text += f"![{entry.summary}](gallery/{entry.name}.png)\n\n"
        reference = REFERENCES.get(entry.name, "eight")
        text += f"```console\n$ rpctl track {entry.name} --reference {reference}\n```\n"
    return text


PAGES = {
    "reference/command_line": commands,
    "reference/keys": keys,
    "reference/api": api,
    "gallery": gallery,
}


def write(app: Any) -> None:
    """Write the pages whose text has changed."""
    for name, page in PAGES.items():
        path = Path(app.srcdir, f"{name}.md")
        text = HEAD + page()
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def as_text(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Let the bars of docstrings, of |x|, be bars, and no substitutions."""
    lines[:] = [re.sub(r"(``.*?``)|\|", lambda found: found[1] or "\\|", line) for line in lines]


def setup(app: Any) -> dict[str, bool]:
    """Write the pages before Sphinx looks for files."""
    app.connect("builder-inited", write)
    app.connect("autodoc-process-docstring", as_text)
    return {"parallel_read_safe": True}
