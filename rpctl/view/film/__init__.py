"""Films and pictures of a run, drawn by a headless browser."""
