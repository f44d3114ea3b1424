"""xacro, expanded by its own package in a process of its own."""
