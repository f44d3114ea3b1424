"""Predictive laws: the tracking error, what to ask of the robot, and the efforts that give it."""
