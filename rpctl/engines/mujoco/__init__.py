"""MuJoCo: a robot as a plain model that any MuJoCo runs, on a ground with friction."""
