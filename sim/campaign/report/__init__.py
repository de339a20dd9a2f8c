"""What a campaign tells: one HTML page, and JUnit XML.

    Campaign, Runs, Verdict ──> page ──> report.html (page.html: a template, everything escaped)
                             │   ├─> charts: shares with intervals, distributions ──> sim.drawing
                             │   └─> failures: groups; runs worth a look ──> sim.scenario, worst/
                             └> junit ──> junit.xml

The data set holds figures, no pictures: the runs that are shown are copied from `failed/` or
repeated with their drawn values. The page carries a policy by which a browser loads nothing and
runs no script.
"""

from sim.campaign.report.junit import write_campaign_junit as write_campaign_junit
from sim.campaign.report.page import write_report as write_report
