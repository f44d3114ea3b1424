"""A simulator of the user's in the place of the plant, and the plants by their names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rpctl
from rpctl import ControllerOutput, Plant, ReducedDynamics, Rest, Robot, RpctlError
from rpctl.simulation.plants.protocol import PlantSample
from rpctl.simulation.plants.rolling import RollingMotion
from rpctl.simulation.plants.settings import Noise
from rpctl.simulation.plants.starting import PLANTS, plant_by_name


class Mine:
    """Rolls as the reduced model does, but knows nothing of the loop."""

    def __init__(self) -> None:
        self.commanded: list[float] = []

    def start(self, robot: Robot, rest: Rest) -> Mine:
        self._t, self._motion = 0.0, RollingMotion(ReducedDynamics(robot), rest.q, 0.002)
        return self

    def step(self, command: ControllerOutput, dt: float) -> PlantSample:
        self.commanded.append(float(command.efforts[0]))
        self._motion.advance(command.efforts, dt)
        self._t += dt
        return PlantSample(self._t, self._motion.q, self._motion.nu)


def test_own_simulator_gets_the_efforts_and_gives_the_measurements(paper: Robot) -> None:
    mine = Mine()
    start = (0.1, -0.05, 0.2)
    run = rpctl.track(
        paper, "circle", duration=0.2, initial_error=start, plant=mine, collisions=False
    )
    same = rpctl.track(
        paper, "circle", duration=0.2, initial_error=start, collisions=False, backend="pinocchio"
    )
    np.testing.assert_allclose(run.q, same.q, atol=1e-12)
    np.testing.assert_allclose(run.tau, same.tau, atol=1e-9)
    np.testing.assert_array_equal(mine.commanded, run.tau[:-1, 0])
    assert "a simulator of the user's, Mine, moved the robot" in run.notes
    assert not rpctl.summarize(run).nominal
    assert run.config.plant == Plant(kind="own")  # what a file can say
    with pytest.raises(RpctlError, match="which a file cannot store"):
        rpctl.track(paper, "circle", duration=0.2, plant=run.config.plant, collisions=False)


def test_a_simulator_that_does_not_go_on_is_refused(paper: Robot) -> None:
    class Late(Mine):
        def step(self, command: ControllerOutput, dt: float) -> PlantSample:
            return super().step(command, 0.5 * dt)

    with pytest.raises(RpctlError, match=r"measures at t = 0\.001 s, where it was to be"):
        rpctl.track(paper, "circle", duration=0.1, plant=Late(), collisions=False)


def test_what_is_no_plant_is_refused(paper: Robot) -> None:
    with pytest.raises(RpctlError, match="give ideal, perturbed, slipping, contact, a Plant, or"):
        rpctl.track(paper, "circle", duration=0.1, plant=3)  # type: ignore[arg-type]
    with pytest.raises(RpctlError, match="plant 'contakt' is not known; did you mean contact"):
        rpctl.track(paper, "circle", duration=0.1, plant="contakt")
    with pytest.raises(RpctlError, match="the slipping plant takes efforts"):
        rpctl.track(paper, "circle", duration=0.1, plant="slipping", output="velocity")


def test_plants_by_name(paper: Robot) -> None:
    given = Plant(delay=0.01, kind="contact")
    assert PLANTS == ("ideal", "perturbed", "slipping", "contact")
    assert plant_by_name("ideal", paper, given) == Plant()
    assert plant_by_name("perturbed", paper, given) == Plant(delay=0.01)
    assert plant_by_name("perturbed", paper).masses == {"*": 1.1}
    assert plant_by_name("slipping", paper, given) == Plant(delay=0.01, kind="slipping")


@pytest.mark.parametrize("kind", ["ideal", "slipping"])
def test_a_plant_stepped_by_hand_is_that_of_track(paper: Robot, kind: str) -> None:
    """The same controller in a loop of ten lines, with noise and a delay of two periods."""
    plant = replace(plant_by_name(kind, paper), delay=0.004, noise=Noise(position=1e-3), seed=3)
    run = rpctl.track(
        paper, "circle", duration=0.1, plant=plant, collisions=False, backend="pinocchio"
    )
    stepped = rpctl.start_plant(paper, plant, run.q[0])
    controller = rpctl.Controller(paper, "circle", rest=stepped.rest)
    for row in run.q[1:]:
        stepped.step(controller.step(*stepped.sample), 0.002)
        np.testing.assert_allclose(stepped.state.q, row, atol=1e-12)
    assert stepped.sample.t == pytest.approx(0.1)
    assert abs(stepped.sample.q[0] - stepped.state.q[0]) > 1e-6  # the controller sees noise
