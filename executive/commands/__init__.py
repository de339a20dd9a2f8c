"""The catalogue of requests, the life of a command, and whether one may enter."""
