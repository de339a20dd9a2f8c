"""Campaigns: thousands of runs of scenarios with drawn values, and one verdict with confidence."""
