"""Reports: one self-contained HTML file for a flight, or for a comparison of many. The only user of the plotting library."""

from cosim.report.flight_page import flight_report

__all__ = ["flight_report"]
