"""MOPS messages by the ten thousand over a bad link, between processes that are killed."""
