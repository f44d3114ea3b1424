"""The reduced dynamics: rolling constraints, basis, projection, motion."""
