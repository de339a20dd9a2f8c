"""Drawings of runs: the map, the timeline, and the common style.

They are drawn from plain data (`DriveMap`, `RunTimeline`) of any run as matplotlib figures.
Importing this package loads matplotlib, so commands import it late.
"""

from sim.drawing.lanes import Panel as Panel
from sim.drawing.lanes import Series as Series
from sim.drawing.lanes import line as line
from sim.drawing.lanes import mark as mark
from sim.drawing.map import SMALL_ROVER as SMALL_ROVER
from sim.drawing.map import DriveMap as DriveMap
from sim.drawing.map import Incident as Incident
from sim.drawing.map import draw_map as draw_map
from sim.drawing.map import thinned as thinned
from sim.drawing.passage import SHORT_S as SHORT_S
from sim.drawing.passage import Levels as Levels
from sim.drawing.passage import Passage as Passage
from sim.drawing.passage import ReportTimes as ReportTimes
from sim.drawing.run_plot import draw_run as draw_run
from sim.drawing.run_plot import plot_of as plot_of
from sim.drawing.run_plot import write_plot as write_plot
from sim.drawing.style import COMMAND as COMMAND
from sim.drawing.style import DONE as DONE
from sim.drawing.style import FAINT as FAINT
from sim.drawing.style import GRID as GRID
from sim.drawing.style import INK as INK
from sim.drawing.style import MOTION as MOTION
from sim.drawing.style import POINT as POINT
from sim.drawing.style import WARNED as WARNED
from sim.drawing.style import WRONG as WRONG
from sim.drawing.style import as_png as as_png
from sim.drawing.style import as_svg as as_svg
from sim.drawing.style import styled_figure as styled_figure
from sim.drawing.style import write_drawing as write_drawing
from sim.drawing.timeline import CommandLane as CommandLane
from sim.drawing.timeline import RunTimeline as RunTimeline
from sim.drawing.timeline import TimeSpan as TimeSpan
from sim.drawing.timeline import draw_timeline as draw_timeline
from sim.drawing.timeline import events_of as events_of
from sim.drawing.timeline import lane_of as lane_of
