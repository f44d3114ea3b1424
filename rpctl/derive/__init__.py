"""Closed forms: the reduced equations as text, LaTeX, Python and C."""
