"""Closed forms: the reduced equations as text, LaTeX, Python and C."""

from importlib.util import find_spec

from rpctl.errors import RpctlError
from rpctl.libraries import install_command

if find_spec("sympy") is None:
    raise RpctlError(
        f"closed forms need SymPy, which is not installed; run {install_command('derive')}"
    )
