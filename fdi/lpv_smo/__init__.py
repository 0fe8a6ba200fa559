"""Sliding-mode observer on an affine LPV model [Alwi14]: one for any such model by `design`, one that flies."""

import importlib
from typing import Any

__all__ = ("Design", "canonical", "design", "load", "save", "verify")


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module("fdi.lpv_smo.lpv_smo"), name)
