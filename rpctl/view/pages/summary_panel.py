"""The texts beside the scene, as HTML; every string from outside is escaped here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import PurePath
from typing import Any

from rpctl.control.approach import Approach
from rpctl.control.leash import Leash
from rpctl.control.unregistered import name_of, settings_of
from rpctl.simulation.obstacles import OBSTACLE_SETTINGS, run_obstacles
from rpctl.simulation.run import Run
from rpctl.simulation.summary import Summary
from rpctl.view.charts import has_base
from rpctl.view.obstacles import OBSTACLE_TITLES, obstacle_texts
from rpctl.view.pages.merits import (
    certificate_badge,
    headline_rows,
    limits_badge,
    merits_section,
    outcome_badge,
)
from rpctl.view.pages.page import definitions, escape, section
from rpctl.view.pages.plant_texts import variation_texts
from rpctl.view.scene.stand_ins import StandIn, label, note

JOINTS = "joints: "  # how the sentence on the joints' gains begins
JOINTS_LABEL = "Joints"  # of that sentence, too long for a row
NESTED_LAWS = ("base", "inner", "fallback")  # laws within laws
SHOWN_WITHIN = ("leash", "approach", "joint_horizon", "joint_horizon_dyn", "midpoint")
SETTING_LABELS = {
    "reference": "Reference",
    "kinematic": "Kinematic law",
    "dynamic": "Dynamic law",
    "base": "Law of the base",
    "inner": "Law within",
    "horizon": "Horizon h, s",
    "horizon_dyn": "Horizon h₁, s",
    "beta": "β",
    "steps": "Steps N",
    "dt": "Step, s",
    "period": "Time from solve to solve, s",
    "end_effector_radius": "End effector's radius, m",
    "base_radius": "Base's radius, m",
    "leash": "Leash, m",
    "bound": "Leash (m, rad)",
    "approach": "Approach from (m, rad)",
    "joint_horizon": "Joints' horizon h, s",
    "joint_horizon_dyn": "Joints' horizon h₁, s",
    "joint_gain": "Joints' gain k, 1/s",
    "midpoint": "M, h of the period's middle",
    "body_clearance": "Links keep clear by, m",
    "computing_time": "Computing time, s",
    "dropped": "Samples dropped, of 1",
    "lag": "Lag, s",
    "dead_time": "Dead time, s",
    "delay": "Delay, s",
    "smooth": "Reference smoothed by, m",
    "retime": "Reference retimed",
    "lever": "Lever, m",
    "damping": "Damping, m/s",
    "gain": "Gain k, 1/s",
    "softened": "Solves with a softened bound",
    "largest_lag": "Reference read late by, s",
    "duration": "Duration, s",
    "control_period": "Control period, s",
    "plant_step": "Integration step, s",
    "smoothing": "Smoothing ω₀, rad/s",
    "initial_error": "Initial error (m, m, rad)",
}
KEYBOARD = (
    ("Space", "play, pause"),
    ("← →", "1 s back, on; with Shift 0.1 s"),
    ("Home, End", "start, end"),
    ("+ −", "faster, slower"),
    ("R, T, F", "overview, from above, follow"),
    ("D", "dark or light"),
)


def panel(run: Run, summary: Summary, notes: Sequence[str], linear_loop: str = "") -> str:
    """Return the panel: figures of merit, poles, certificate, settings, robot, notes, keys.

    Args:
        run: The run.
        summary: Its figures of merit.
        notes: Notes on the scene, in sentences.
        linear_loop: The section on the linear loop, HTML.
    """
    sections = (
        merits_section(run, summary),
        linear_loop,
        _certificate(run.certificate),
        _settings(run),
        _robot(run),
        notes_section(notes),
        keyboard_section(),
    )
    return "\n".join(section for section in sections if section)


def legend(run: Run, stand_ins: Iterable[StandIn] = ()) -> str:
    """Return the scene's legend, whose entries show and hide what is drawn.

    Args:
        run: The run.
        stand_ins: What is drawn in the place of missing meshes.
    """
    entries = [("base", "Base")] if has_base(run) else []
    entries += [("tip", "End effector")] if run.log.ee.shape[1] == 3 else []
    entries += [("desired", "Desired"), ("ghost", "Reference robot")]
    first = [legend_entry(key, text) for key, text in entries]
    efforts = [legend_entry("effort", "Effort as colour", shown=False), effort_key(run)]
    entries = []
    if run.log.tip_margin.size:
        one = ": equally stiff contacts" if run.log.load_range.size else ""
        entries += [("loads", f"Ground reactions{one}")] if run.log.contact_load.size else []
        entries += [("zmp", "Support, zero-moment point")]
    rest = [legend_entry(key, text) for key, text in entries]
    return "".join([*first, *stand_in_entry(stand_ins), *efforts, *rest, *obstacle_entries([run])])


def stand_in_entry(stand_ins: Iterable[StandIn]) -> list[str]:
    """Return the entry of the scene's legend that names what is hatched; none where nothing is."""
    stand_ins = tuple(stand_ins)
    if not stand_ins:
        return []
    return [legend_entry("stand-in", label(stand_ins), title=note(stand_ins, most=len(stand_ins)))]


def effort_key(run: Run) -> str:
    """Return the scale of the colours of efforts, which is hidden while efforts are not shown."""
    limits = [math.isfinite(limit) and limit > 0.0 for limit in run.robot.effort_limits]
    full = "limit" if all(limits) else "limit or peak" if any(limits) else "peak"
    title = {
        "limit": "of each joint's effort limit",
        "peak": "of each joint's largest effort in this run, as the robot has no limits",
        "limit or peak": "of each joint's effort limit; without one, of its largest effort",
    }[full]
    return (
        f'<li class="ramp" data-key="effort" title="{title}" hidden><i class="effort"></i>'
        f"<span><b>0</b><b>50 %</b><b>{full}</b></span></li>"
    )


def obstacle_entries(runs: Iterable[Run]) -> list[str]:
    """Return the entries of the scene's legend for the obstacles of runs."""
    bodies = {obstacle.body for run in runs for obstacle in run_obstacles(run)}
    return [
        legend_entry(f"obstacles-{body}", text)
        for body, text in OBSTACLE_TITLES.items()
        if body in bodies
    ]


def keyboard_section() -> str:
    """Return the section on the keys."""
    return section("Keyboard", definitions(KEYBOARD))


def legend_entry(
    layer: str, text: str, style: str = "", shown: bool = True, title: str = ""
) -> str:
    """Return one entry of the scene's legend; ``style`` is CSS of its swatch.

    Args:
        layer: What it shows and hides; a CSS class too.
        text: Its name.
        style: CSS of its swatch.
        shown: Whether it is shown at first.
        title: What more is to be said of it.
    """
    more = f' title="{escape(title)}"' if title else ""
    drawn = f' style="{style}"' if style else ""
    pressed = str(shown).lower()
    return (
        f'<li><button type="button" data-layer="{layer}" aria-pressed="{pressed}"{more}>'
        f'<i class="{layer}"{drawn}></i>{escape(text)}</button></li>'
    )


def headline(run: Run, summary: Summary) -> str:
    """Return the few figures that stand above everything else."""
    rows = headline_rows(run, summary)
    figures = "".join(f"<div><dt>{label}</dt><dd>{value}</dd></div>" for label, value in rows)
    badges = [outcome_badge(summary)]
    if run.certificate is not None:
        badges.append(certificate_badge(run.certificate, "dynamics verified"))
    badges.append(limits_badge(summary.limits_violated))
    return f'<dl class="figures">{figures}</dl><p class="badges">{"".join(badges)}</p>'


def subtitle(run: Run) -> str:
    """Return one line about the run, escaped."""
    count = len(run.robot.quasi_velocities)
    words = [f"{count} quasi-velocities", f"{len(run.robot.actuators)} actuators"]
    words.insert(0, f"reference: {setting_text(run.config.run.reference)}")
    words.append(f"{float(run.t[-1] - run.t[0]):.4g} s")
    return escape(" · ".join(words))


def _certificate(certificate: Mapping[str, Any] | None) -> str:
    if certificate is None:
        return ""
    checks = certificate["checks"]
    rows = [(f"{check['name']} · {check['against']}", residual(check)) for check in checks]
    rows += [
        (check["name"], f"{check['against']}: {check['note']}") for check in certificate["skipped"]
    ]
    samples, seed = certificate.get("samples"), certificate.get("seed")
    sampling = f"Worst of {samples} random states, seed {seed}."
    mark = certificate_badge(certificate)
    quiet = f'<p class="quiet">{escape(sampling)}</p>'
    return section("Dynamics" + mark, definitions(rows) + quiet)


def residual(check: Mapping[str, Any]) -> str:
    """Return a check's residual beside its limit."""
    known = check["residual"] is not None and math.isfinite(check["residual"])
    worst = f"{check['residual']:.1e}" if known else "∞"
    sign, mark = ("≤", "") if check["passed"] else (">", " ✗")
    return f"{worst} {sign} {check['limit']:.0e}{mark}"


def _settings(run: Run) -> str:
    rows = setting_texts(run)
    joints = rows.pop(JOINTS_LABEL, "")
    sentence = f'<p class="quiet">{escape(JOINTS_LABEL)}: {escape(joints)}</p>' if joints else ""
    return section("Settings", definitions(rows.items()) + sentence)


def setting_texts(run: Run) -> dict[str, str]:
    """Return the settings of a run as texts by their labels."""
    rows: dict[str, str] = {}
    for key, settings in _setting_groups(run):
        for name, value in settings:
            if name in NESTED_LAWS and is_dataclass(value):
                value = name_of(value)
            if isinstance(value, Leash | Approach):
                name = "bound" if isinstance(value, Leash) else name
                value = (value.distance, value.heading)
            if value in (None, ()) or isinstance(value, Mapping) or is_dataclass(value):
                continue
            if name not in OBSTACLE_SETTINGS:
                text = SETTING_LABELS.get(name, name.replace("_", " ").capitalize())
                rows[f"{text} ({key})" if text in rows else text] = setting_text(value)
        rows |= obstacle_texts(getattr(run.config, key)) if key in ("kinematic", "dynamic") else {}
        rows |= variation_texts(run.config.plant, run.robot) if key == "plant" else {}
    return rows


def _within(law: object) -> list[tuple[str, object]]:
    """Return the settings of a law within a law that a reader looks for."""
    inner = [getattr(law, name, None) for name in ("base", "inner")]
    found = [pair for each in inner if is_dataclass(each) for pair in settings_of(each).items()]
    return [(name, value) for name, value in found if name in SHOWN_WITHIN]


def _setting_groups(run: Run) -> Iterator[tuple[str, Sequence[tuple[str, object]]]]:
    """Yield the settings of a run, name and value, in groups, in the order that is shown."""
    settings, plant, output = run.config.run, run.config.plant, run.config.output
    for key in ("reference", "duration", "initial_error"):
        yield key, [(key, getattr(settings, key))]
    laws = ("kinematic",) if output is not None else ("kinematic", "dynamic")
    for key in laws:
        law = getattr(run.config, key)
        yield key, [(key, name_of(law)), *settings_of(law).items(), *_within(law)]
    if output is not None:
        own = [(f"lag of {name}", lag) for name, lag in output.lags.items()]
        times = [("lag", output.lag), *own, ("dead_time", output.dead_time)]
        yield "output", [("output", "velocity"), *times]
    joints = [each for each in run.law_sentences if each.startswith(JOINTS)]
    yield "joints", [("joints", each.removeprefix(JOINTS)) for each in joints]
    for key in ("control_period", "plant_step"):
        yield key, [(key, getattr(settings, key))]
    yield "run", [("smooth", settings.smooth), ("retime", settings.retime or None)]
    biases = [(f"bias of {name}", bias) for name, bias in plant.tau_bias.items()]
    biases += [(f"friction of {name}", each) for name, each in plant.joint_friction.items()]
    late = [("lag", plant.lag), *((f"lag of {name}", lag) for name, lag in plant.lags.items())]
    late.append(("dead_time", plant.dead_time))
    names = ("delay", "dropped", "computing_time")
    late += [(name, getattr(plant, name) or None) for name in names]
    yield "plant", [*biases, *late, ("believed", run.controller_model)]
    yield "kinematic_report", [*run.kinematic_report.items()]


def _robot(run: Run) -> str:
    drive = run.robot.drive
    rows = [("Drive", str(drive.type))]
    if drive.wheels:
        radii = dict.fromkeys(f"{wheel.radius:.4g}" for wheel in drive.wheels)
        rows.append(("Wheels", f"{len(drive.wheels)}, radius {', '.join(radii)} m"))
    rows += [
        ("Quasi-velocities", str(len(run.robot.quasi_velocities))),
        ("Actuators", str(len(run.robot.actuators))),
        ("Frozen joints", str(len(run.robot.locked))),
    ]
    if run.robot.end_effector is not None:
        rows.append(("End effector", run.robot.end_effector))
    names = escape(", ".join(run.robot.quasi_velocities))
    body = f"<details><summary>Names</summary><p>{names}</p></details>"
    return section("Robot", definitions(rows) + body)


def notes_section(notes: Sequence[str]) -> str:
    """Return the section of notes, empty where there are none."""
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return section(f"Notes ({len(notes)})", f'<ul class="notes">{items}</ul>')


def setting_text(value: Any) -> str:
    """Return a setting as text; of a file only its name, as reports are passed on."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(setting_text(item) for item in value)
    text = str(value)
    return PurePath(text).name if PurePath(text).is_absolute() else text
