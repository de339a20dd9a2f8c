"""The `rover` command for people."""
