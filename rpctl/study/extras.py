"""The libraries of ``rpctl[study]``, imported when they are needed."""

from __future__ import annotations

from typing import Any

from rpctl.errors import RpctlError
from rpctl.libraries import library

INSTALL = "pip install 'rpctl[study]'"


def salib(module: str) -> Any:
    """Return a module of SALib.

    Raises:
        RpctlError: It is not installed.
    """
    return _extra(f"SALib.{module}")


def arrow() -> Any:
    """Return ``pyarrow``.

    Raises:
        RpctlError: It is not installed.
    """
    return _extra("pyarrow")


def parquet() -> Any:
    """Return ``pyarrow.parquet``.

    Raises:
        RpctlError: It is not installed.
    """
    return _extra("pyarrow.parquet")


def _extra(module: str) -> Any:
    package = module.partition(".")[0]
    try:
        return library(module)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise RpctlError(f"this study needs {package}; {INSTALL}") from None
