"""A run: its samples, its robot, its file."""
