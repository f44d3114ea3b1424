"""The version of rpctl."""

VERSION = "0.2.0"
