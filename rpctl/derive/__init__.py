"""Closed forms: the reduced equations as text, LaTeX, Python and C."""

from importlib.util import find_spec

from rpctl.errors import RpctlError

if find_spec("sympy") is None:
    raise RpctlError("closed forms need SymPy, which is not installed; pip install 'rpctl[derive]'")
