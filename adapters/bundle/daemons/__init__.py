"""Attached to NASA ION: a bridge process that holds pyion, and the client that talks to it."""
