"""What stands beside a scene: figures of merit, settings and the legend, of one run or several."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeGuard

from rpctl.simulation.merits.collision_facts import clearance_text, collision_texts
from rpctl.simulation.merits.obstacles import run_obstacles
from rpctl.simulation.merits.outcome import SUCCESSES
from rpctl.simulation.merits.path_error import lag, length
from rpctl.simulation.merits.summary import Summary
from rpctl.simulation.run.run import Run
from rpctl.view.charts import NOISE, has_base
from rpctl.view.labels import capital
from rpctl.view.pages.page import Badge, Cell, LegendEntry, Section, Table, stand_in_entry
from rpctl.view.pages.settings import GAINS, GAINS_LABEL, setting_text, setting_texts
from rpctl.view.scene.stage import OBSTACLE_TITLES
from rpctl.view.scene.stand_ins import StandIn

MERIT_LABELS = {
    "rms_base_error": "Base, rms",
    "final_base_error": "Base, final",
    "final_lateral_error": "Base, final lateral",
    "rms_base_path_error": "Base off its path, rms",
    "base_lag": "Base behind, at most",
    "rms_end_effector_error": "End effector, rms",
    "final_end_effector_error": "End effector, final",
    "rms_end_effector_path_error": "End effector off its path, rms",
}
HEADLINE = ("rms_base_error", "rms_base_path_error", "rms_end_effector_error")
NOMINAL = "Ideal plant: the simulated robot equals the controller's model."
SYMBOLS = (
    "q: configuration; ν: quasi-velocities (speeds of the base: v or vx forward, vy to the left, "
    "omega turning; joint rates); S: basis, v = S ν; M: inertia; h: bias, of velocities (C ν) and "
    "gravity (g); B: actuation; τ: efforts; A, λ: rolling constraints and their multipliers; "
    "G: Gibbs function"
)
NONE = "–"  # in a table
EFFORT_SCALES = {  # what the end of the colours of efforts is, and that in full
    "limit": "of each joint's effort limit",
    "peak": "of each joint's largest effort in this run, as the robot has no limits",
    "limit or peak": "of each joint's effort limit; without one, of its largest effort",
}
KEYBOARD = Section(
    "Keyboard",
    rows=(
        ("Space", "play, pause"),
        ("← →", "1 s back, on; with Shift 0.1 s"),
        ("Home, End", "start, end"),
        ("+ −", "faster, slower"),
        ("R, T, F", "overview, from above, follow"),
        ("D", "dark or light"),
    ),
)


def panel(
    run: Run, summary: Summary, notes: Sequence[str], linear_loop: Section | None = None
) -> list[Section]:
    """Return the panel of a run.

    Args:
        run: The run.
        summary: Its figures of merit.
        notes: Notes on the scene, in sentences.
        linear_loop: The section on the linear loop.
    """
    certificate = None if run.certificate is None else _certificate(run.certificate)
    middle = (linear_loop, certificate, _settings(run), _robot(run))
    return [
        _merits_section(run, summary), *filter(None, middle), *notes_section(notes), KEYBOARD,
    ]  # fmt: skip


def subtitle(run: Run) -> str:
    """Return one line about the run."""
    return (
        f"reference: {setting_text(run.config.run.reference)} · "
        f"{len(run.robot.quasi_velocities)} quasi-velocities · {len(run.robot.actuators)} actuators"
        f" · {float(run.t[-1] - run.t[0]):.4g} s"
    )


# ---- figures of merit ---------------------------------------------------------------------


def merits(run: Run, summary: Summary) -> dict[str, str]:
    """Return the run's figures of merit as texts by their keys; a fixed base has none of a base."""
    base, tip = summary.base_path, summary.end_effector_path
    figures: dict[str, float | None] = {
        **{key: getattr(summary, key) for key in MERIT_LABELS if hasattr(summary, key)},
        "rms_base_path_error": base.rms,
        "rms_end_effector_path_error": None if tip is None else tip.rms,
    }
    texts = {
        key: length(figure) if figure >= NOISE or not figure else "< 1 µm"
        for key, figure in figures.items()
        if is_finite(figure)
    }
    if is_finite(base.largest_lag):
        texts["base_lag"] = lag(base.largest_lag, base.largest_lag_distance)
    return {
        key: texts[key]
        for key in MERIT_LABELS
        if key in texts and (has_base(run) or "end_effector" in key)
    }


def headline_rows(run: Run, summary: Summary) -> list[tuple[str, str]]:
    """Return the few figures that stand above everything else, with their labels."""
    known = merits(run, summary)
    rows = [(MERIT_LABELS[key], known[key]) for key in HEADLINE if key in known]
    return rows + _effort_row("Effort / limit", summary)


def headline_badges(run: Run, summary: Summary) -> list[Badge]:
    """Return the verdicts that stand above everything else."""
    checked = [] if run.certificate is None else [_verified(run.certificate, "dynamics verified")]
    return [outcome_badge(summary), *checked, limits_badge(summary)]


def _merits_section(run: Run, summary: Summary) -> Section:
    rows = [(MERIT_LABELS[key], text) for key, text in merits(run, summary).items()]
    rows += _effort_row("Largest effort / limit", summary)
    if is_finite(summary.realtime_factor):
        rows.append(("Simulated at", f"{summary.realtime_factor:.3g} × real time"))
    marks = outcome_badge(summary), limits_badge(summary)
    return Section("Tracking error", marks, rows=rows, notes=list(_sentences(run, summary)))


def _effort_row(label: str, summary: Summary) -> list[tuple[str, str]]:
    ratio = summary.max_effort_ratio
    return [(label, f"{100.0 * ratio:.0f} %")] if is_finite(ratio) else []


def _sentences(run: Run, summary: Summary) -> Iterator[str]:
    """Yield what there is to say of a run, beside its figures."""
    yield f"{summary.outcome.capitalize()}: {summary.outcome_sentence}."
    if summary.nominal:
        yield NOMINAL
    if run.recording is not None and run.recording["sentence"]:
        yield f"The reference: {run.recording['sentence']}."
    if run.perturbed is not None:
        yield f"Expect, {run.perturbed['sentence']}."
    for broken in summary.limits_violated:
        yield (
            f"{broken.joint}: {broken.limit} {broken.value:.4g}, allowed "
            f"{broken.allowed:.4g}, from {broken.first_time:.2f} s"
        )
    yield from (f"{each.sentence}." for each in summary.limits_bound)
    yield from (f"{each}." for each in collision_texts(summary.collisions))
    if summary.clearances:
        yield f"Smallest distance: {', '.join(map(clearance_text, summary.clearances))}."
    for each in (*summary.collision_notes, summary.energy_sentence):
        if each:
            yield f"{capital(each)}."
    if summary.ground.sentence:
        yield f"On the ground: {summary.ground.sentence}."
    if summary.felt_ground is not None:
        yield f"In the plant: {summary.felt_ground.sentence}."


def outcome_badge(summary: Summary) -> Badge:
    """Return the badge of what became of a run."""
    return Badge(summary.outcome in SUCCESSES, summary.outcome)


def limits_badge(summary: Summary) -> Badge:
    """Return the badge of the limits that were broken."""
    broken = bool(summary.limits_violated)
    return Badge(not broken, "limits broken" if broken else "within limits")


def _verified(certificate: Mapping[str, Any], text: str = "verified") -> Badge:
    passed = bool(certificate["passed"])
    return Badge(passed, text if passed else "not verified")


def is_finite(figure: float | None) -> TypeGuard[float]:
    """Return whether a figure of merit is a finite number."""
    return figure is not None and math.isfinite(figure)


# ---- certificate, settings, robot, notes --------------------------------------------------


def _certificate(certificate: Mapping[str, Any]) -> Section:
    rows = [
        (
            f"{check['name']} · {check['against']}",
            residual(check["passed"], check["residual"], check["limit"]),
        )
        for check in certificate["checks"]
    ]
    rows += [
        (each["name"], f"{each['against']}: {each['note']}") for each in certificate["skipped"]
    ]
    samples, seed = certificate.get("samples"), certificate.get("seed")
    return Section(
        "Dynamics",
        [_verified(certificate)],
        rows=rows,
        quiet=f"Worst of {samples} random states, seed {seed}.",
        details=("Symbols", f"{SYMBOLS}."),
    )


def residual(passed: bool, value: float | None, limit: float) -> str:
    """Return a check's residual beside its limit."""
    worst = (f"{value:.1e}" if value else "0") if is_finite(value) else "∞"
    sign, mark = ("≤", "") if passed else (">", " ✗")
    return f"{worst} {sign} {limit:.0e}{mark}"


def _settings(run: Run) -> Section:
    rows = setting_texts(run)
    gains = rows.pop(GAINS_LABEL, "")
    sentence = f"{GAINS_LABEL}: {gains}" if gains else ""
    return Section("Settings", rows=list(rows.items()), quiet=sentence)


def _robot(run: Run) -> Section:
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
    return Section("Robot", rows=rows, details=("Names", ", ".join(run.robot.quasi_velocities)))


def notes_section(notes: Sequence[str]) -> list[Section]:
    """Return the section of notes, if there are any but on the gains, which the settings tell."""
    told = [note for note in notes if not note.startswith(GAINS)]
    return [Section(f"Notes ({len(told)})", notes=told)] if told else []


# ---- several runs -------------------------------------------------------------------------


def compare_panel(
    runs: Sequence[Run], names: Sequence[str], summaries: Sequence[Summary], notes: Sequence[str]
) -> list[Section]:
    """Return the panel of several runs: figures of merit, settings, notes, keys.

    Args:
        runs: The runs.
        names: What they are called.
        summaries: Their figures of merit.
        notes: Notes on the scene, in sentences.
    """
    texts = [merits(run, summary) for run, summary in zip(runs, summaries, strict=True)]
    rows: dict[str, list[Cell]] = {
        name: [text.get(key, NONE) for text in texts] for key, name in MERIT_LABELS.items()
    }
    ratios = [summary.max_effort_ratio for summary in summaries]
    rows["Largest effort / limit"] = [
        f"{100.0 * v:.0f} %" if is_finite(v) else NONE for v in ratios
    ]
    rows = {name: cells for name, cells in rows.items() if set(cells) != {NONE}}
    rows["Outcome"] = [outcome_badge(summary) for summary in summaries]
    rows["Limits"] = [limits_badge(summary) for summary in summaries]
    rows["Dynamics"] = [
        NONE if run.certificate is None else _verified(run.certificate) for run in runs
    ]
    return [
        Section("Tracking error", table=Table(names, list(rows.items()), coloured=True)),
        Section("Settings", table=Table(names, _setting_rows(runs), coloured=True)),
        *notes_section(notes),
        KEYBOARD,
    ]


def _setting_rows(runs: Sequence[Run]) -> list[tuple[str, Sequence[Cell]]]:
    """Return the settings by label; those in which the runs differ stand first, in bold."""
    columns = [{"Robot": run.robot.name, **setting_texts(run)} for run in runs]
    labels = dict.fromkeys(label for column in columns for label in column)
    alike: list[tuple[str, Sequence[Cell]]] = []
    apart: list[tuple[str, Sequence[Cell]]] = []
    for name in labels:
        cells = [column.get(name, NONE) for column in columns]
        if len(set(cells)) > 1:
            apart.append((name, [(cell, "") for cell in cells]))
        else:
            alike.append((name, cells))
    return [*apart, *alike]


# ---- the scene's legend -------------------------------------------------------------------


def legend(run: Run, stand_ins: Sequence[StandIn] = ()) -> list[LegendEntry]:
    """Return the scene's legend, whose entries show and hide what is drawn.

    Args:
        run: The run.
        stand_ins: What is drawn in the place of missing meshes.
    """
    entries = [LegendEntry("base", "Base")] if has_base(run) else []
    entries += [LegendEntry("tip", "End effector")] if run.log.ee.shape[1] == 3 else []
    entries += [LegendEntry("desired", "Desired"), LegendEntry("ghost", "Reference robot")]
    entries += filter(None, [stand_in_entry(stand_ins)])
    limits = [math.isfinite(limit) and limit > 0.0 for limit in run.robot.effort_limits]
    end = "limit" if all(limits) else "limit or peak" if any(limits) else "peak"
    scale = (end, EFFORT_SCALES[end])
    entries.append(LegendEntry("effort", "Effort as colour", shown=False, scale=scale))
    if run.log.tip_margin.size:
        one = ": equally stiff contacts" if run.log.load_range.size else ""
        loads = [LegendEntry("loads", f"Ground reactions{one}")] * bool(run.log.contact_load.size)
        entries += [*loads, LegendEntry("zmp", "Support, zero-moment point")]
    return entries + _obstacle_entries([run])


def compare_legend(
    runs: Sequence[Run], names: Sequence[str], stand_ins: Sequence[StandIn] = ()
) -> list[LegendEntry]:
    """Return the scene's legend: every run, the desired paths, obstacles, and the ghost.

    Args:
        runs: The runs.
        names: What they are called.
        stand_ins: What is drawn in the place of missing meshes of the first run's robot.
    """
    entries = [motion_entry(k, name) for k, name in enumerate(names)]
    if any(has_base(run) or run.log.ee.shape[1] for run in runs):
        entries.append(LegendEntry("desired", "Desired"))
    entries += filter(None, [stand_in_entry(stand_ins), *_obstacle_entries(runs)])
    return [*entries, LegendEntry("ghost", "Reference robot", shown=False)]


def motion_entry(k: int, name: str, shown: bool = True) -> LegendEntry:
    """Return the entry of one of several motions; the first is drawn solid."""
    return LegendEntry(f"run-{k + 1}", name if k else f"{name} (solid)", colour=k, shown=shown)


def _obstacle_entries(runs: Iterable[Run]) -> list[LegendEntry]:
    bodies = {obstacle.body for run in runs for obstacle in run_obstacles(run)}
    named = ((body, text) for body, text in OBSTACLE_TITLES.items() if body in bodies)
    return [LegendEntry(f"obstacles-{body}", text) for body, text in named]
