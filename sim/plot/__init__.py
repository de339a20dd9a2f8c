"""`rover plot`: a recorded run as a picture, which `rover scenario --out` draws, too."""

from sim.plot.recorded import plot_of, write_plot

__all__ = ["plot_of", "write_plot"]
