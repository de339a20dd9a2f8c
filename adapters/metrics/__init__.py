"""Metrics of a process for Prometheus: its counters, the page, and the HTTP server.

Processes count with `Histogram` and `ReportCounter`. `exposition` makes the page and serves it; it
is imported late aboard, for it imports the client library. Nothing here reads a command.
"""

from adapters.metrics.counts import Histogram as Histogram
from adapters.metrics.counts import ReportCounter as ReportCounter
