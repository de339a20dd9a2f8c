"""`rover demo`: a mission-control session with a simulated rover, its display and its files."""
