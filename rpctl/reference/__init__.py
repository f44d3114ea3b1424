"""References of base, arm and end effector."""
