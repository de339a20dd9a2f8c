"""`rover calibrate`: what `adapters.calibration` finds of a simulated drive, or of a recording."""
