"""Robust fast adaptive fault estimation [Sun13]: an estimator for any linear model by `design`, two that fly."""

import importlib
from typing import Any

__all__ = (
    "Design", "DesignError", "Region", "design", "estimate_E", "first_order", "fit_first_order", "global_model",
    "reduce_E", "separate",
)  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module("fdi.rfafe.rfafe"), name)
