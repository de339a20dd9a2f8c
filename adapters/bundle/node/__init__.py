"""A bundle node without its links: settings, store, and what goes in and out."""
