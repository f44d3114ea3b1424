"""Predictive laws: from the tracking error to a command, and from the command to efforts."""
