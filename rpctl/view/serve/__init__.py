"""A live scene on a loopback server."""
