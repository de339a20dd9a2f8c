"""Reports of a campaign: one HTML page, and JUnit XML.

    Campaign, Runs, Verdict ──> page ──> report.html (page.html: a template, everything escaped)
                             │   ├─> charts: shares with intervals, distributions ──> sim.drawing
                             │   └─> failures: groups; selected runs ──> sim.scenario, worst/

The data set has figures, no pictures: the displayed runs are copied from `failed/` or
repeated with their drawn values. By the page's content security policy a browser loads
nothing and runs no script.
"""

from sim.campaign.report.junit import write_campaign_junit as write_campaign_junit
from sim.campaign.report.page import write_report as write_report
