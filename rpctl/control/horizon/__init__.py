"""The horizon law: the base's motion over the next second as one quadratic program a sample."""
