"""PyBullet as an engine of the referee."""
