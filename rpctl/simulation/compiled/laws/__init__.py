"""The laws of the controller as statements of a program."""
