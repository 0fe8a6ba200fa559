"""Reports: one self-contained HTML file for a flight, or for many. Only here is the plotting library used."""

from cosim.report.compare_page import comparison_report, write_comparison
from cosim.report.diagnosis_page import diagnosis_report
from cosim.report.flight_page import flight_report
from cosim.report.reproduce_page import reproduction_report

__all__ = [
    "comparison_report", "diagnosis_report", "flight_report", "reproduction_report", "write_comparison",
]  # fmt: skip
