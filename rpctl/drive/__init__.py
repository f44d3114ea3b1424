"""Wheels, swivels and their planar geometry: what a wheeled base is, detected or declared."""
