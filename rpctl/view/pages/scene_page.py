"""The bare scene as a page, which films, stills and notebooks show; a run as notebooks show it."""

from __future__ import annotations

import base64
from pathlib import PurePath

import numpy as np

from rpctl.errors import RpctlError
from rpctl.simulation.run.run import Run
from rpctl.view.pages.page import StandInBadge, asset, embed, render, render_page
from rpctl.view.pages.third_party import licences, meshcat_script
from rpctl.view.scene.scene import Scene, build_scene

HIDDEN_GHOST_DISTANCE = 2e-3  # m, rad: a ghost as near as that is hidden behind its robot
ASPECT = 16.0 / 9.0  # of the scene in a notebook
MAX_WIDTH_PX = 960  # pixels, at most


def player(scene: Scene, title: str, script: str, controls: bool = False) -> str:
    """Return a page that shows a scene and nothing else.

    Args:
        scene: The scene.
        title: What it shows.
        script: What moves the scene, by ``player.show(time)``.
        controls: Whether a timeline lies over the scene.
    """
    data = {
        "duration": scene.duration,
        "frames": len(scene.times),
        "covered": HIDDEN_GHOST_DISTANCE,
        "hull": np.round(scene.hull, 3).tolist(),
        "commands": [base64.b64encode(command).decode() for command in scene.commands],
    }
    return render_page(
        "player.html",
        title=title,
        styles=["player.css"],
        scripts=(meshcat_script(), asset("player.js") + asset("camera.js"), script),
        dark=False,
        controls=controls,
        stand_in=StandInBadge.of(scene.stand_ins),
        licences=licences(charts=False),
        data=embed(data),
    )


def show(run: Run) -> str:
    """Return a run as HTML for a notebook: one line of text, and its scene with controls.

    Where the robot cannot be loaded any more, the reason stands in the place of the scene.
    """
    page, fault, name = "", "", run.robot.name
    try:
        scene = build_scene(run.load_robot(), run)
    except RpctlError as error:
        fault = str(error)
    else:
        page = player(scene, name, asset("notebook.js"), controls=True)
    shown = {"width": MAX_WIDTH_PX, "aspect": f"{ASPECT:.4f}", "page": page, "fault": fault}
    return render("notebook.html", summary=_summary_line(run), title=name, **shown)


def _summary_line(run: Run) -> str:
    """Return what the run is, and how well it ended, in one line."""
    errors = []
    if run.robot.drive.wheels:
        errors.append(f"base {1e3 * np.hypot(*run.log.e[-1, :2]):.3g} mm")
    if run.robot.end_effector is not None:
        errors.append(
            f"end effector {1e3 * np.linalg.norm(run.log.ee_ref[-1] - run.log.ee[-1]):.3g} mm"
        )
    reference = PurePath(run.config.run.reference).name  # no folder of this machine
    duration = run.t[-1] - run.t[0]
    return f"{run.robot.name}, {reference}, {duration:.4g} s; final error: {', '.join(errors)}"
