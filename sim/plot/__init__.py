"""`rover plot`: a recorded run as a picture."""
