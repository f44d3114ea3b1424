"""The bare scene as a page: what films, stills and notebooks show."""

from __future__ import annotations

import base64
from string import Template

import numpy as np

from rpctl.view.pages.page import asset, embed, escape, policy
from rpctl.view.pages.third_party import licences_html, meshcat_script
from rpctl.view.scene.camera import FIELD_OF_VIEW, fit_camera
from rpctl.view.scene.scene import Scene
from rpctl.view.scene.stand_ins import label, note

HIDDEN_GHOST_DISTANCE = 2e-3  # m, rad: a ghost as near as that is hidden behind its robot


def player(scene: Scene, title: str, aspect: float, script: str, controls: str = "") -> str:
    """Return a page that shows a scene and nothing else.

    Args:
        scene: The scene.
        title: What it shows.
        aspect: Width over height of the page; the camera is placed for it.
        script: What moves the scene, by ``player.show(time)``.
        controls: What lies over the scene, as HTML.
    """
    scripts = (meshcat_script(), asset("player.js"), script)
    return Template(asset("player.html")).substitute(
        policy=policy(*scripts),
        title=escape(title),
        css=asset("player.css"),
        controls=controls,
        badge=_badge(scene),
        licences=licences_html(charts=False),
        data=_data(scene, aspect),
        scripts="\n".join(f"<script>{text}</script>" for text in scripts),
    )


def _badge(scene: Scene) -> str:
    """Return what tells that something stands in for missing meshes, as HTML."""
    text = label(scene.stand_ins)
    if not text:
        return ""
    more = note(scene.stand_ins, most=len(scene.stand_ins))
    return f'<p class="badge" title="{escape(more)}">{escape(text)}</p>'


def _data(scene: Scene, aspect: float) -> str:
    camera = fit_camera(scene.hull, aspect)
    placed = {"eye": camera.eye, "target": camera.target}
    return embed(
        {
            "duration": scene.duration,
            "frames": len(scene.times),
            "covered": HIDDEN_GHOST_DISTANCE,
            "camera": {
                **{key: np.round(place, 4).tolist() for key, place in placed.items()},
                "depth": camera.depth,
                "fov": FIELD_OF_VIEW,
            },
            "commands": [base64.b64encode(command).decode() for command in scene.commands],
        }
    )
