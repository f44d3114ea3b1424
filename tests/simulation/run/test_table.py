"""The flat table of a run: each column is what its name says, in CSV and in pandas alike."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.simulation.run import table as table_module
from rpctl.simulation.run.table import columns


@pytest.fixture(scope="module")
def run() -> rpctl.Run:
    return rpctl.track(
        rpctl.load("mixed_chain"), "circle", duration=0.05, initial_error=(0.1, -0.05, 0.1)
    )


def test_columns_are_the_logs(run: rpctl.Run) -> None:
    table, log = columns(run.log, run.robot, run.ground), run.log
    np.testing.assert_array_equal(table["t"], run.t)
    places = {
        "theta": log.base[:, 2],
        "y_ref": run.base_ref[:, 1],
        "e_lateral": log.e[:, 1],
        "nu_omega": run.nu[:, 1],
        "nu_d_v": log.nu_d[:, 0],
        "ee_z": log.ee[:, 2],
        "ee_x_ref": log.ee_ref[:, 0],
        "energy": log.energy,
    }
    for index, name in enumerate(run.robot.joint_names):
        places[name] = log.joints[:, index]
        places[f"{name}_ref"] = log.joints_ref[:, index]
        places[f"e_{name}"] = log.e[:, 3 + index]
        places[f"nu_ref_{name}"] = log.nu_ref[:, 2 + index]
    for index, name in enumerate(run.robot.actuators):
        places[f"tau_{name}"] = run.tau[:, index]
        places[f"rate_{name}"] = log.rates[:, index]
    for index, name in enumerate(run.ground.contacts):
        places[f"load_{name}"] = log.contact_load[:, index]
    for name, column in places.items():
        np.testing.assert_array_equal(table[name], column, err_msg=name)


def test_a_joint_called_x_loses_no_column(run: rpctl.Run) -> None:
    names = ("x", *run.robot.joint_names[1:])
    table = columns(run.log, replace(run.robot, joint_names=names), run.ground)
    np.testing.assert_array_equal(table["x"], run.log.base[:, 0])
    np.testing.assert_array_equal(table["joint_x"], run.log.joints[:, 0])
    np.testing.assert_array_equal(table["joint_x_ref"], run.log.joints_ref[:, 0])


@pytest.mark.parametrize("size", [4, 10_000])
def test_csv_holds_the_exact_numbers(
    run: rpctl.Run, tmp_path: Path, size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_module, "CSV_ROWS", size)
    table = columns(run.log, run.robot, run.ground)
    with run.to_csv(tmp_path / "run.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(table)
    np.testing.assert_array_equal(
        np.array(rows, dtype=float), np.column_stack(list(table.values()))
    )


def test_csv_quotes_names(run: rpctl.Run, tmp_path: Path) -> None:
    strange = ('a "b", c', *run.robot.joint_names[1:])
    renamed = replace(run, robot=replace(run.robot, joint_names=strange))
    with renamed.to_csv(tmp_path / "run.csv").open(newline="") as file:
        assert strange[0] in next(csv.reader(file))


@pytest.mark.slow  # pandas takes seconds to load
def test_pandas(run: rpctl.Run) -> None:
    pytest.importorskip("pandas")
    frame = run.to_pandas()
    assert frame.index.name == "t"
    np.testing.assert_array_equal(frame.index, run.t)
    np.testing.assert_array_equal(frame["nu_omega"], run.nu[:, 1])
    assert frame.shape == (len(run.t), len(columns(run.log, run.robot, run.ground)) - 1)
