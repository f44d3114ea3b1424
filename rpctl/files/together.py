"""Files that belong together: a folder never holds some of one set and some of another."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rpctl.errors import RpctlError
from rpctl.files.writing import make_folder, write_atomically


def write_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files of one set; wherever it ends, those that are there are of one set.

    The first file holds all that the others show. These are removed before it is replaced, and
    written after: what is left early is the older first file alone, or the new one with some of
    the others. Other files of the folder stay.

    Args:
        folder: Where; made if it is not there.
        files: Their contents by name, the first one first.

    Raises:
        RpctlError: The folder cannot be made or written to.
    """
    make_folder(folder)
    first, *rest = files
    try:
        for name in rest:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise RpctlError(f"{folder}: cannot be written: {error.strerror or error}") from None
    for name in (first, *rest):
        write_atomically(folder / name, files[name], follow_links=False)
