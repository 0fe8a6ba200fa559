"""Reports: one self-contained HTML file for a flight, or for a comparison of many. The only user of the plotting library."""

from cosim.report.compare_page import comparison_report
from cosim.report.flight_page import flight_report

__all__ = ["comparison_report", "flight_report"]
