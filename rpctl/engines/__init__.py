"""Other simulators of a robot: MuJoCo, Drake, PyBullet, behind one protocol."""
