"""Figures of merit of a run."""
