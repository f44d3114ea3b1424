"""Contacts that are as hard as what stands on them needs, whatever hangs above them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rpctl.equivalence.contact.inverse_mass import vertical_inverse_masses

ALIKE = 3.0  # inverse masses within this factor: MuJoCo's number is left, the robot stands level


def even_contacts(spec: Any, geoms: Iterable[str]) -> None:
    """Let contacts sink as the robot's mass on them has it, not as that of a caster's wheel.

    MuJoCo softens a contact by R = (1 − d)/d w, d its impedance and w the inverse mass of its body
    in all directions; see :func:`rpctl.equivalence.contact.inverse_mass.vertical_inverse_masses`.
    Where that is far more, a contact gets the d for which R is that of the inverse mass against
    vertical forces there. As MuJoCo divides direct stiffness and damping by d, these are multiplied
    by as much as d grows.

    Args:
        spec: The ``MjSpec``, complete, whose pairs have the names of geoms.
        geoms: Names of the geoms that meet the ground.
    """
    try:
        model = spec.compile()
    except ValueError:
        return  # it is told where the model is needed
    pairs = {pair.name: pair for pair in spec.pairs}
    ids = {name: int(model.geom(name).id) for name in geoms if name in pairs}
    if not ids:
        return
    upwards = vertical_inverse_masses(model, ids.values())
    for (name, geom), vertical in zip(ids.items(), upwards.tolist(), strict=True):
        ratio = float(model.body_invweight0[model.geom_bodyid[geom], 0]) / vertical
        if ratio <= ALIKE:
            continue
        pair = pairs[name]
        before = float(pair.solimp[1])
        pair.solimp[:2] = [_harder(float(d), ratio) for d in pair.solimp[:2]]
        scale = float(pair.solimp[1]) / before
        for numbers in (pair.solref, pair.solreffriction):
            if numbers[0] < 0.0:  # stiffness and damping, not a time constant
                numbers[:] = [scale * value for value in numbers]


def _harder(impedance: float, ratio: float) -> float:
    """Return the impedance d for which d/(1 − d) is ``ratio`` times that of another."""
    odds = ratio * impedance / (1.0 - impedance)
    return odds / (1.0 + odds)
