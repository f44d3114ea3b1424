"""The certificate of three robots: an independent derivation agrees to rounding."""

import rpctl


def main() -> None:
    for name in ("paper", "mixed_chain", "tiago"):
        certificate = rpctl.verify(rpctl.load(name), samples=20)
        worst = certificate.worst
        verdict = "verified" if certificate.passed else "NOT verified"
        print(f"{name:12} {verdict}: {worst.name} is {worst.residual:.1e} of {worst.limit:.0e}")


if __name__ == "__main__":
    main()
