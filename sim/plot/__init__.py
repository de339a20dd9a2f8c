"""`rover plot`: a recorded run as a picture, which `rover scenario --out` draws, too."""

from sim.plot.recorded import plot_of as plot_of
from sim.plot.recorded import write_plot as write_plot
