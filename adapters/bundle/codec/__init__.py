"""Bundles (RFC 9171) as values and as octets."""
