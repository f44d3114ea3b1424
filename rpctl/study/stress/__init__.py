"""A battery of stresses: how far each law holds as circumstances worsen."""
