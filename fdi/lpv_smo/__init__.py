"""Sliding-mode observer on an affine LPV model [Alwi14]: one for any such model by `design`, one that flies."""

from fdi.lpv_smo.synthesis import Design, canonical, design, load, verify

__all__ = ("Design", "canonical", "design", "load", "verify")
