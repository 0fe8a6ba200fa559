"""Figures of the site's pages."""

import base64
import io
from typing import Any

import matplotlib.pyplot as plt

plt.switch_backend("svg")
plt.rcParams.update({"svg.hashsalt": "site", "figure.figsize": (7.2, 3.4), "figure.constrained_layout.use": True})
plt.rcParams.update({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3, "lines.linewidth": 1.2})


def html(caption: str, figure: Any = None) -> str:
    """Return a matplotlib Figure, by default the current one, as HTML and close all; ValueError if none was drawn."""
    if figure is None and not plt.get_fignums():
        raise ValueError(f"no figure was drawn for {caption!r}")
    out = io.BytesIO()
    (figure or plt.gcf()).savefig(out, format="svg", metadata={"Date": None})
    plt.close("all")
    image = base64.b64encode(out.getvalue()).decode()
    return f'<img alt="{caption}" src="data:image/svg+xml;base64,{image}"><p><em>{caption}</em></p>'
