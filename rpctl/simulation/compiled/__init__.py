"""The closed loop as machine code: the same laws and the same plant as `simulation/`, in lanes.

`symbols/` has the dynamics in CasADi's symbols, `laws/` and `plant/` make statements of them, and
`loop.py` joins these to a program. `machine/` compiles it. `tracking_loop.py` does one run,
`rollouts.py` many side by side.
"""
