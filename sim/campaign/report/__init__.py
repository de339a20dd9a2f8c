"""What a campaign tells: one HTML page, and JUnit XML."""

from sim.campaign.report.junit import write_campaign_junit
from sim.campaign.report.page import write_report

__all__ = ["write_campaign_junit", "write_report"]
