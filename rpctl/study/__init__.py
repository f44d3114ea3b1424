"""Many runs: scenarios, grids, Monte Carlo and their standings."""
