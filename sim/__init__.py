"""Simulated rovers in simulated worlds: scenarios, campaigns, calibration and drawings of runs."""
