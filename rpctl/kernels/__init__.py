"""Formulas over scalars become programs, and these machine code; no robots and no laws here."""
