"""`rover plot`: a recorded run as a picture; also used by `rover scenario --out`."""

from sim.plot.recorded import plot_of as plot_of
from sim.plot.recorded import write_plot as write_plot
