"""Descriptions: a URDF read strictly, as immutable records."""
