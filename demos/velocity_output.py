"""A base that takes speeds, and follows them late: its lag learnt on the way, or known before.

First the robot is sent speeds as if it followed them at once; its controller learns that it does
not. The log of that run tells lag and dead time, which the second run knows from the start.
"""

import rpctl

LATE = rpctl.Plant(lag=0.1, dead_time=0.05)  # s; what a real robot would not tell
PERIOD = 0.02  # s


def main() -> None:
    robot = rpctl.load("tiago")
    start = (0.1, 0.05, 0.1)  # m, m, rad off the reference: enough of a step to tell the lag
    log = rpctl.track(
        robot,
        "eight",
        duration=4.0,
        initial_error=start,
        control_period=PERIOD,
        output="velocity",
        plant=LATE,
    )
    found = rpctl.lag_from(log)
    print(f"lag {1e3 * found.lag:.0f} ms, dead time {1e3 * found.dead_time:.0f} ms")
    for name, output in (("learnt on the way", "velocity"), ("known before", found.output())):
        run = rpctl.track(robot, "eight", control_period=PERIOD, output=output, plant=LATE)
        figures = rpctl.summarize(run)
        tip = figures.rms_end_effector_error or 0.0
        print(
            f"{name:17} base {1e3 * figures.rms_base_error:5.2f} mm rms, "
            f"end effector {1e3 * tip:5.2f} mm"
        )


if __name__ == "__main__":
    main()
