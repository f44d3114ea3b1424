"""Programs that run in lanes, an interpreter of them, and their machine code."""
