"""References that are planned: through waypoints, and along a path of the end effector."""
