"""The certificate of every robot of the catalogue: independent derivations agree to rounding.

Usage: python demos/verify_robots.py [names of robots, all if left out]
"""

import sys
import time

import rpctl
from rpctl.robot.catalog import names


def main(*chosen: str) -> None:
    start = time.perf_counter()
    for name in chosen or names():
        try:
            certificate = rpctl.verify(rpctl.load(name), samples=20)
        except rpctl.RpctlError as error:
            print(f"{name:16} not modelled: {str(error).partition('.urdf: ')[2] or error}")
            continue
        checks, worst = certificate.checks, certificate.worst
        failed = [f"{check.name} against {check.against}" for check in checks if not check.passed]
        verdict = f"NOT verified: {', '.join(failed)}" if failed else "verified"
        print(
            f"{name:16} {verdict}; {len(checks)} checks; nearest to its limit: "
            f"{worst.name} against {worst.against}, {worst.residual:.0e} of {worst.limit:.0e}"
        )
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main(*sys.argv[1:])
