"""``rpctl`` and ``python -m rpctl``: signals are answered before anything else is imported."""

from __future__ import annotations

from rpctl.cli.interrupts import leave_at_signals


def main() -> None:
    """Run the command line."""
    leave_at_signals()
    from rpctl.cli.app import main as run

    run()


if __name__ == "__main__":
    main()
