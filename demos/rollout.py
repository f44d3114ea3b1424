"""Two hundred runs of the paper's robot that differ in masses, friction, noise and start.

Prints quantiles, and how to replay the worst run; draws the distance from the reference over time.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import rpctl

COUNT = int(sys.argv[1]) if len(sys.argv) > 1 else 200
OUT = Path("runs/rollout")
SCATTER = {
    "plant.masses.*": rpctl.Uniform(0.8, 1.2),
    "plant.joint_friction.wheel_*": rpctl.LogUniform(0.01, 0.5),  # N m
    "plant.noise.heading": rpctl.Uniform(0.0, 0.01),  # rad
    "run.initial_error.x": rpctl.Normal(0.0, 0.1),  # m
    "run.initial_error.y": rpctl.Normal(0.0, 0.1),
    "run.initial_error.theta": rpctl.Normal(0.0, 0.3, low=-1.0, high=1.0),  # rad
}
MERITS = ("settled_rms_base_error", "final_base_error", "max_effort_ratio", "settling_time")

robot = rpctl.load("paper")
runs = rpctl.rollout(robot, "eight", SCATTER, count=COUNT, duration=10.0, seed=1)
print(runs)
print(f"{'':24}{'median':>10}{'95 %':>10}{'worst':>10}  worst run")
for name in MERITS:
    middle, most, worst = (runs.quantile(name, p) for p in (0.5, 0.95, 1.0))
    print(f"{name:24}{middle:10.3g}{most:10.3g}{worst:10.3g}  {runs.worst(name)[0]}")

worst = int(runs.worst("settled_rms_base_error")[0])
OUT.mkdir(parents=True, exist_ok=True)
rpctl.write_config(runs.config(worst), OUT / "worst.toml")
for name, value in zip(runs.names, runs.parameters[worst], strict=True):
    print(f"  {name} = {value:.3g}")
print(f"replay it: rpctl track paper --config {OUT / 'worst.toml'}")

figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for label, outer, colour in (("all runs", 0.5, "#c7dcec"), ("the middle half", 0.25, "#8ebbda")):
    low, high = np.nanquantile(runs.base_error, (0.5 - outer, 0.5 + outer), axis=0)
    axes.fill_between(runs.t, low, high, color=colour, linewidth=0, label=label)
axes.plot(runs.t, np.nanmedian(runs.base_error, axis=0), color="tab:blue", label="median")
axes.plot(runs.t, runs.base_error[worst], color="tab:red", label=f"run {worst}, the worst")
axes.set(xlabel="time, s", ylabel="distance from the reference, m", yscale="log", ylim=(1e-5, None))
axes.margins(x=0)
axes.legend(frameon=False)
figure.savefig(OUT / "rollout.png", dpi=150)
print(f"wrote {OUT / 'rollout.png'}")
