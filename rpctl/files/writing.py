"""Files and JSON: whole or not at all, and only what JSON can say."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpctl.errors import RpctlError


def write_atomically(path: str | Path, data: bytes) -> Path:
    """Write a file; it is there whole or not at all, also after Ctrl-C.

    Args:
        path: The file; an older one is replaced.
        data: Its content.

    Returns:
        The path.

    Raises:
        RpctlError: The folder is not there or cannot be written to.
    """
    path = Path(path)
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(
            dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as file:
            temporary = Path(file.name)
            file.write(data)
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise RpctlError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
    return path


def to_json(value: Any) -> str:
    """Return strict, indented JSON; a number that is not finite becomes null."""
    return json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
