"""The closed loop as machine code: the laws and the plant of a run, in lanes.

`rpctl/dynamics/symbols/` has the dynamics over scalars, and the laws of `rpctl/control/` make
statements of them; `plant.py` and `implicit_step.py` are the robot's motion. `loop.py` joins these
to a program, and `build.py` has `rpctl/kernels/` compile it. `lanes.py` runs it, for one run with
its log (`tracking_loop.py`) and for many side by side (`build.py`).
"""
