"""The three-dimensional scene: bodies, markers, trails and obstacles as meshcat commands."""
