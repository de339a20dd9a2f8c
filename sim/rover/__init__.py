"""Simulated rovers in MuJoCo worlds, behind the ports of an executive."""
