"""Mesh files: found, read and measured in confined processes."""
