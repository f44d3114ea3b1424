"""The closed loop as machine code: the same laws and the same plant as `simulation/`, in lanes.

`symbols/` has the dynamics in CasADi's symbols, `laws/` and `plant/` make statements of them,
`loop.py` joins these to a program, and `build.py` has `rpctl/kernels/` compile it. `lanes.py` runs
it, for one run with its log (`tracking_loop.py`) and for many side by side (`rollouts.py`).
"""
