"""Drake as an engine of the referee."""
