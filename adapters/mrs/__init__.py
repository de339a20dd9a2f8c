"""METERON Robotic Services on MAL: specification, provider (aboard) and client (ground)."""
