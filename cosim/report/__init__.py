"""Reports: one self-contained HTML file for a flight, or for many. Only here is the plotting library used.

The names below are imported when they are first used: the page of a flight needs no statistics.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cosim.report.compare_page import comparison_report, write_comparison
    from cosim.report.diagnosis_page import diagnosis_report
    from cosim.report.flight_page import flight_report
    from cosim.report.reproduce_page import reproduction_report

__all__ = ["comparison_report", "diagnosis_report", "flight_report", "reproduction_report", "write_comparison"]
_PAGES = {"flight_report": "flight_page", "diagnosis_report": "diagnosis_page", "reproduction_report": "reproduce_page"}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'cosim.report' has no attribute {name!r}")
    return getattr(importlib.import_module(f"cosim.report.{_PAGES.get(name, 'compare_page')}"), name)
