"""What long work says when it ends early: what is kept, and how to go on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rpctl.cli.terminal import console, escape


@contextmanager
def kept_told(folder: Path, again: str) -> Iterator[None]:
    """Say how to go on where a Ctrl-C ends the runs of the ``with`` block early.

    Args:
        folder: Where the runs that have ended are kept.
        again: The command line that goes on.
    """
    try:
        yield
    except KeyboardInterrupt:
        out = console(stderr=True)
        out.print(f"what is done is kept in [bold]{escape(str(folder))}[/]; go on with")
        out.print(f"  {escape(again)}", soft_wrap=True)
        raise
