"""A file's bytes, or why there are none."""

from __future__ import annotations

from pathlib import Path

from rpctl.errors import DescriptionError, Finding
from rpctl.files.caps import cap

FIX = "give a URDF file or a name listed by `rpctl robots`"


def read_source(path: Path) -> bytes:
    """Return a regular file's bytes, as many as a URDF may have and one more.

    Raises:
        DescriptionError: There is no such file, or it is none that ends.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise DescriptionError(path, [Finding("error", None, f"not a regular file; {FIX}")])
        with path.open("rb") as file:
            return file.read(cap("MAX_BYTES") + 1)
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: links in a loop
        reason = getattr(error, "strerror", None) or str(error)
        raise DescriptionError(path, [Finding("error", None, f"{reason}; {FIX}")]) from None
