"""The version of rpctl."""

VERSION = "0.1.0"
