"""Several runs on one page: a scene with the first as it is and the others as ghosts, and texts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from rpctl.simulation.obstacles import run_obstacles
from rpctl.simulation.run import Run
from rpctl.simulation.summary import Summary
from rpctl.view.charts import has_base
from rpctl.view.pages.merits import (
    MERIT_LABELS,
    certificate_badge,
    is_finite,
    limits_badge,
    merits,
    outcome_badge,
)
from rpctl.view.pages.page import escape
from rpctl.view.pages.summary_panel import (
    keyboard_section,
    legend_entry,
    notes_section,
    obstacle_entries,
    setting_texts,
    stand_in_entry,
)
from rpctl.view.scene import obstacle_shapes, threejs
from rpctl.view.scene.ground import ground_command, lights_command
from rpctl.view.scene.scene import ACTUAL, REFERENCE, ROBOTS_PATH, Scene
from rpctl.view.scene.stand_ins import StandIn

GHOST_RUN_OPACITY = 0.55
TRAILS_PATH, GROUND_PATH, ANIMATION_COMMAND = "/rpctl/trails", "/rpctl/ground", "set_animation"
PALETTE_SIZE = 12  # colours --c0 to --c11 of the style sheet


def merge(runs: Sequence[Run], scenes: Sequence[Scene]) -> Scene:
    """Return one scene of several.

    Nodes of run k, from 2, are named ``run2-robot-1``, ``run2-trail-base`` and so on; where runs
    share a robot, they share its meshes. The obstacles of all are drawn, each once.

    Args:
        runs: At least one.
        scenes: Their scenes.
    """
    first = scenes[0]
    ground = float(runs[0].robot.drive.ground)
    lower = np.min([scene.lower for scene in scenes], axis=0)
    upper = np.max([scene.upper for scene in scenes], axis=0)
    around = {
        "/rpctl/lights": lights_command(lower, upper),
        GROUND_PATH: ground_command(lower, upper, ground),
    }
    obstacles = tuple(dict.fromkeys(each for run in runs for each in run_obstacles(run)))
    size = max(float(scene.start[1, 2]) for scene in scenes) - ground
    others = [{_command_key(c): c for c in map(_unpack, scene.commands)} for scene in scenes[1:]]
    commands = []
    for packed in first.commands:
        command = _unpack(packed)
        path = _command_key(command)
        if path == obstacle_shapes.OBSTACLES_PATH:
            continue
        for k, other in enumerate(others, 2):
            if path == ROBOTS_PATH:
                _add_ghost(command["object"], other[path]["object"], k)
            elif path == TRAILS_PATH:
                known = covered_trails(runs[0], runs[k - 1])
                _add_trails(command["object"], other[path]["object"], k, known)
            elif path == ANIMATION_COMMAND:
                _add_motion(command, other[path], k)
        commands.append(around.get(path) or threejs.pack(command))
        if path == GROUND_PATH:
            commands += obstacle_shapes.commands(obstacles, lower, upper, ground, size)
    return replace(
        first,
        commands=tuple(commands),
        times=max((scene.times for scene in scenes), key=lambda times: float(times[-1])),
        lower=lower,
        upper=upper,
        hull=np.concatenate([scene.hull for scene in scenes]),
        notes=tuple(dict.fromkeys(note for scene in scenes for note in scene.notes)),
    )


def _unpack(command: bytes) -> threejs.Json:
    import umsgpack

    return dict(umsgpack.unpackb(command))


def _command_key(command: threejs.Json) -> str:
    """Return a command's path, or its type if it has none."""
    return str(command["path"] or command["type"])


def _add_ghost(scene: threejs.Json, other: threejs.Json, k: int) -> None:
    """Add another run's robot with the ghost's material; the page gives it the run's colour."""
    names = _share_geometries(scene, other, k)
    tint = next(m for m in other["materials"] if m["uuid"] == "tint")
    scene["materials"].append({**tint, "uuid": f"tint-{k}", "opacity": GHOST_RUN_OPACITY})
    for group in other["object"]["children"]:
        if not group["name"].startswith(f"{REFERENCE}-"):
            continue
        name = f"run{k}-{ACTUAL}" + group["name"].removeprefix(REFERENCE)
        children = [
            {
                **mesh,
                "uuid": f"run{k}-{mesh['uuid']}",
                "name": f"run{k}-{mesh['name']}",
                "geometry": names[mesh["geometry"]],
                "material": f"tint-{k}" if mesh["material"] == "tint" else mesh["material"],
            }
            for mesh in group["children"]
        ]
        scene["object"]["children"].append(
            {**group, "uuid": name, "name": name, "children": children}
        )


def _share_geometries(scene: threejs.Json, other: threejs.Json, k: int) -> dict[str, str]:
    """Add the geometries that the scene lacks; return the name of each in the scene."""
    known = {threejs.pack(g["data"]): g["uuid"] for g in scene["geometries"] if "data" in g}
    names = {}
    for geometry in other["geometries"]:
        same = known.get(threejs.pack(geometry["data"])) if "data" in geometry else None
        if same is None:
            same = f"run{k}-{geometry['uuid']}"
            scene["geometries"].append({**geometry, "uuid": same})
        names[geometry["uuid"]] = same
    return names


def covered_trails(first: Run, other: Run) -> set[str]:
    """Return the names of the desired trails of a run that coincide with the first run's."""
    count = len(other.t)
    if count > len(first.t) or not np.allclose(first.t[:count], other.t):
        return set()
    pairs = {
        "trail-base-desired": (first.base_ref[:count, :2], other.base_ref[:, :2]),
        "trail-tip-desired": (first.log.ee_ref[:count], other.log.ee_ref),
    }
    return {name for name, (a, b) in pairs.items() if a.shape == b.shape and np.allclose(a, b)}


def _add_trails(scene: threejs.Json, other: threejs.Json, k: int, known: set[str]) -> None:
    """Add another run's trails except the names in ``known``."""
    for kind in ("geometries", "materials"):
        scene[kind] += [{**item, "uuid": f"run{k}-{item['uuid']}"} for item in other[kind]]
    names = ("uuid", "name", "geometry", "material")
    scene["object"]["children"] += [
        {**node, **{name: f"run{k}-{node[name]}" for name in names}}
        for node in other["object"]["children"]
        if node["name"] not in known
    ]


def _add_motion(command: threejs.Json, other: threejs.Json, k: int) -> None:
    """Add another run's motion to the one clip that is played."""
    (animation,), (motion,) = command["animations"], other["animations"]
    animation["clip"]["tracks"] += [
        {**track, "name": f"run{k}-{track['name']}"}
        for track in motion["clip"]["tracks"]
        if track["name"].startswith(f"{ACTUAL}-")
    ]


def compare_panel(
    runs: Sequence[Run],
    names: Sequence[str],
    summaries: Sequence[Summary],
    notes: Sequence[str],
) -> str:
    """Return the panel of several runs: figures of merit, settings, notes, keys.

    Args:
        runs: The runs.
        names: What they are called.
        summaries: Their figures of merit.
        notes: Notes on the scene, in sentences.
    """
    texts = [merits(run, summary) for run, summary in zip(runs, summaries, strict=True)]
    rows = [(label, [text.get(key, "–") for text in texts]) for key, label in MERIT_LABELS.items()]
    effort_ratios = [summary.max_effort_ratio for summary in summaries]
    rows.append(
        ("Largest effort / limit", [f"{v:.0%}" if is_finite(v) else "–" for v in effort_ratios])
    )
    rows = [(label, cells) for label, cells in rows if set(cells) != {"–"}]
    marks = [
        ("Outcome", [outcome_badge(summary) for summary in summaries]),
        ("Limits", [limits_badge(summary.limits_violated) for summary in summaries]),
        (
            "Dynamics",
            ["–" if r.certificate is None else certificate_badge(r.certificate) for r in runs],
        ),
    ]
    return "\n".join(
        (
            _table("Tracking error", names, [*rows, *marks]),
            _table("Settings", names, _settings(runs)),
            notes_section(notes),
            keyboard_section(),
        )
    )


def compare_legend(
    runs: Sequence[Run], names: Sequence[str], stand_ins: Iterable[StandIn] = ()
) -> str:
    """Return the scene's legend: every run, the desired paths, obstacles, and the ghost.

    Args:
        runs: The runs.
        names: What they are called.
        stand_ins: What is drawn in the place of missing meshes of the first run's robot.
    """
    entries = [
        legend_entry(
            f"run-{k + 1}", name if k else f"{name} (solid)", f"color: var(--c{k % PALETTE_SIZE})"
        )
        for k, name in enumerate(names)
    ]
    if any(has_base(run) or run.log.ee.shape[1] for run in runs):
        entries.append(legend_entry("desired", "Desired"))
    entries += [*stand_in_entry(stand_ins), *obstacle_entries(runs)]
    return "".join([*entries, legend_entry("ghost", "Reference robot", shown=False)])


def _settings(runs: Sequence[Run]) -> list[tuple[str, list[str]]]:
    """Return the settings by label; those in which the runs differ stand first, in bold."""
    columns = [{"Robot": run.robot.name, **setting_texts(run)} for run in runs]
    labels = dict.fromkeys(label for column in columns for label in column)
    rows = [(label, [column.get(label, "–") for column in columns]) for label in labels]
    rows.sort(key=lambda row: len(set(row[1])) == 1)
    return [
        (label, [f"<b>{escape(c)}</b>" if len(set(cells)) > 1 else escape(c) for c in cells])
        for label, cells in rows
    ]


def _table(title: str, names: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Return a section with a column a run; the cells are HTML already."""
    head = "".join(
        f'<th scope="col"><i style="color: var(--c{k % PALETTE_SIZE})"></i>{escape(name)}</th>'
        for k, name in enumerate(names)
    )
    body = "".join(
        f'<tr><th scope="row">{escape(label)}</th>'
        + "".join(f"<td>{cell}</td>" for cell in cells)
        + "</tr>"
        for label, cells in rows
    )
    return (
        f'<section><h2>{escape(title)}</h2><div class="wide"><table class="runs">'
        f"<thead><tr><td></td>{head}</tr></thead><tbody>{body}</tbody></table></div></section>"
    )
