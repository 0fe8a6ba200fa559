"""Robust fast adaptive fault estimation [Sun13]: an estimator for any linear model by `design`, two that fly."""

from fdi.common.conditions import DesignError, separate
from fdi.rfafe.model import estimate_E, first_order, fit_first_order, global_model, reduce_E
from fdi.rfafe.synthesis import Design, Region, design

__all__ = (
    "Design", "DesignError", "Region", "design", "estimate_E", "first_order", "fit_first_order", "global_model",
    "reduce_E", "separate",
)  # fmt: skip
