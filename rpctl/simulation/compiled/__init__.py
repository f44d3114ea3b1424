"""The closed loop as machine code: the same laws and the same plant as `simulation/`, in lanes."""
