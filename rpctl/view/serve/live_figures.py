"""What the charts of a live page show: errors and efforts, the largest since the last frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.reference.motion import end_effector_reference
from rpctl.robot.model import Robot
from rpctl.simulation.closed_loop import WatchedSample
from rpctl.view.labels import shorten

MILLI = 1e3  # errors are shown in mm and mrad
PERCENT = 100.0
DECIMALS = 3  # of what is sent


class LiveFigures:
    """Errors and efforts of a simulation, gathered between the frames that a page is sent.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot, self._data = robot, robot.model.createData()
        limits = robot.effort_limits
        limited = np.isfinite(limits) & (limits > 0.0)
        # Efforts of N and N m share an axis only as parts of their limits.
        self._shown = np.flatnonzero(limited) if limited.any() else np.arange(len(limits))
        self._scale = np.where(limited, PERCENT / np.where(limited, limits, 1.0), 1.0)
        self._percent = bool(limited.any())
        self._errors, self._efforts = np.empty(0), np.empty(0)

    def charts(self) -> list[dict[str, Any]]:
        """Return the charts for the page: title, unit, limits and the names of the lines."""
        short = shorten([self._robot.actuators[i] for i in self._shown])
        limits = [-PERCENT, PERCENT] if self._percent else []
        unit = "% of limit" if self._percent else "N·m or N, no limits"
        return [
            {
                "title": "Errors",
                "unit": "mm, heading mrad",
                "limits": [],
                "lines": self._error_names(),
            },
            {
                "title": "Efforts",
                "unit": unit,
                "limits": limits,
                "lines": list(short.names),
                "names": short.shared,
            },
        ]

    def add(self, sample: WatchedSample) -> None:
        """Take in a sample; of each line the value of largest magnitude counts."""
        self._errors = _larger(self._errors, self._sample_errors(sample))
        self._efforts = _larger(self._efforts, (self._scale * sample.tau)[self._shown])

    def take(self) -> list[list[float]]:
        """Return the lines' values, one list a chart, and begin anew."""
        taken = [
            [round(float(value), DECIMALS) for value in values]
            for values in (self._errors, self._efforts)
        ]
        self._errors, self._efforts = np.empty(0), np.empty(0)
        return taken

    def _error_names(self) -> list[str]:
        base = ["base", "heading"] if self._robot.drive.base_speeds else []
        return [*base, *(["end effector"] if self._robot.end_effector is not None else [])]

    def _sample_errors(self, sample: WatchedSample) -> Array:
        errors = []
        if self._robot.drive.base_speeds:
            errors += [math.hypot(sample.e[0], sample.e[1]), float(sample.e[2])]
        if self._robot.end_effector is not None:
            wanted = end_effector_reference(self._robot, self._data, sample.state).translation
            actual = self._robot.end_effector_pose(self._data, sample.q).translation
            errors.append(float(np.linalg.norm(wanted - actual)))
        return MILLI * np.array(errors)


def _larger(kept: Array, values: Array) -> Array:
    return values if not kept.size else np.where(np.abs(values) > np.abs(kept), values, kept)
