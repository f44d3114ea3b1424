"""Robots: the URDF, its wheels, and the Pinocchio model on a planar root."""
