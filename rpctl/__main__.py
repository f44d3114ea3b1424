"""``rpctl`` and ``python -m rpctl``: signals are answered before anything else is imported."""

from __future__ import annotations

import os

from rpctl.cli.interrupts import leave_at_signals


def main() -> None:
    """Run the command line."""
    leave_at_signals()
    from rpctl.files.worker import ONE_THREAD

    for name, value in ONE_THREAD.items():  # matrices are small: other threads would only spin
        os.environ.setdefault(name, value)
    from rpctl.cli.app import main as run

    run()


if __name__ == "__main__":
    main()
