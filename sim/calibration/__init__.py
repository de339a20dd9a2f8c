"""`rover calibrate`: applies `adapters.calibration` to a simulated drive, or to a recording."""
