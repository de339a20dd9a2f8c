"""`rover demo`: a mission-control session with a simulated rover, and what is left of it."""
