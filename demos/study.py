"""Runs of a robot that its controller does not quite know: what matters, and gains that stand it.

The study is demos/study.toml; `rpctl study paper demos/study.toml` prints more of it.
"""

import shutil
from pathlib import Path

import rpctl
from rpctl.study.optimise import optimise
from rpctl.study.study import run_study
from rpctl.study.study_file import read_study
from rpctl.study.study_result import read_result


def main() -> None:
    robot, folder = rpctl.load("paper"), Path("runs/study")
    shutil.rmtree(folder, ignore_errors=True)  # a folder of a study is not taken over
    study = read_study(Path(__file__).with_suffix(".toml"), robot)
    run_study(robot, study, folder)
    result = read_result(folder)
    share, low, high = (100.0 * each for each in result.success)
    print(f"{share:.0f} % of {len(result.runs)} runs succeed; 95 % sure: {low:.0f} to {high:.0f} %")
    for found in result.sensitivities:
        if found.merit in ("rms_base_error", "max_effort_ratio"):
            print(f"{found.merit}: what matters most is {', '.join(found.ranking[:2])}")
    worst = result.worst[0]
    print(f"the worst, run {worst.run}: {worst.reason}\n  {worst.command}")

    best = optimise(robot, study, folder)
    for name, each in best["settings"].items():
        print(f"{name}: {each['before']:g} -> {each['after']:.3g}")
    for name in ("before", "after"):
        value = best["validation"][name]["statistic"]["value"]
        print(f"{name}: {1e3 * value:.1f} mm rms: 90 % of fresh runs are nearer")


if __name__ == "__main__":
    main()
