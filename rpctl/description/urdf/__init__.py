"""A URDF's bytes, read strictly."""
