"""A straight line: the paper's law leaves the lateral error where it was, the unified one does not.

The limit of the paper's law has a closed form, x2(0) + h v_r Si(x3(0)) − x1(0) x3(0)/2, for a base
that does at once what it is asked. The robot here has inertia and the line starts softly, so it
ends near that.
"""

import rpctl


def main() -> None:
    robot = rpctl.load("paper")
    for law in (rpctl.PaperKinematic(), rpctl.UnifiedKinematic()):
        for name in ("line", "circle"):
            run = rpctl.track(
                robot, name, duration=15.0, initial_error=(0.0, 0.2, 0.0), kinematic=law
            )
            lateral = rpctl.summarize(run).final_lateral_error
            print(
                f"{type(law).__name__:16} {name:6} "
                f"lateral error: 200.0 mm at the start, {1e3 * lateral:.1f} mm at the end"
            )


if __name__ == "__main__":
    main()
