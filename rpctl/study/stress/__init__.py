"""A battery of stresses: how far each law keeps a robot on its reference as circumstances worsen."""
