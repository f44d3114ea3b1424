"""The closed loop of a run: laws, plant, samples."""
