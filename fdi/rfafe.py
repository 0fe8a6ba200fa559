"""Robust fast adaptive fault estimator [Sun13]: design, model helpers and the block."""

from fdi.rfafe_design import Design, DesignError, Region, design, separate  # noqa: F401
