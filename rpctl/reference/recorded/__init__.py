"""References from a table of poses: splines in time through its rows, or near them."""
