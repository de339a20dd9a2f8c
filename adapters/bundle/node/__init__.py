"""A bundle node without its links: settings, store, and bundle processing."""
