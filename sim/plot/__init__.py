"""Plots of recorded runs."""

from sim.plot.recorded import plot_of, write_plot

__all__ = ["plot_of", "write_plot"]
