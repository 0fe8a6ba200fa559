"""Figures as plain data for plotly.js: colours by name of a CSS variable, so that one figure serves dark and light.

A Figure is what page.js draws. Samples go in as base64 single precision; long curves are reduced to the smallest and
largest value of each interval, so that no peak is lost.
"""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.replay import thinned

COLOURS = ("--blue", "--red", "--green", "--purple", "--orange", "--sky", "--gold", "--muted")
DASHES = ("solid", "dash", "dot", "dashdot")


@dataclass
class Figure:
    """One drawing: `data` and `layout` of plotly.js, and what page.js does with it.

    `time`: its horizontal axes are time and follow cursor and zoom. `detector`: it is hidden with that detector.
    `rows`: [{name, detector}] of a time line, `track`: [{x, y}] per panel, the place at evenly spaced times.
    """

    id: str
    caption: str = ""
    height: int = 260
    data: list = field(default_factory=list)
    layout: dict = field(default_factory=dict)
    time: bool = True
    detector: str | None = None
    rows: list | None = None
    track: list | None = None
    heading: str = ""
    width: int = 0  # least width [px]: on a narrower screen it scrolls by itself, not the page

    def points(
        self, panel: int, *, hover: str = "", mode: str = "markers", detector: str | None = None, **more: Any
    ) -> dict:
        """Draw a trace in panel number `panel`, not named in the legend: "markers" or "lines", or of a `type` of its
        own; return it. `hover` is the template of what the cursor shows; with `detector` it is hidden with that one."""
        kind = {} if "type" in more else {"type": "scatter", "mode": mode}
        own: dict = {"hovertemplate": hover} if hover else {}
        own |= {"meta": {"detector": detector}} if detector else {}
        self.data.append({**kind, "showlegend": False, **own, **place(panel), **more})
        return self.data[-1]

    def curve(
        self, t0: float, dt: float, y: np.ndarray, *, name: str = "", colour: str = "--ink", dash: str = "solid",
        width: float = 1.4, panel: int = 1, legend: bool = True, reduce: Any = None, **more: Any,
    ) -> dict:  # fmt: skip
        """Draw a line through the samples y at t0 + k dt in panel number `panel` and return it; `reduce` is as
        `envelope`, the default."""
        values, every = (reduce or envelope)(y)
        trace = self.points(
            panel, mode="lines", name=name, x0=float(t0), dx=float(dt * every), y=packed(values), hover="%{y:.4g}",
            line={"color": colour, "width": width, "dash": dash}, **{"showlegend": legend and bool(name), **more},
        )  # fmt: skip
        if not legend or name:
            trace["legendgroup"] = name
        return trace

    def grid(self, titles: Sequence[Any], y_titles: Any, columns: Any, span: Any = None, x_title: str = "time, s",
             gap: float = 0.085) -> None:  # fmt: skip
        """Lay out panels row by row with a title each; `y_titles` is a list, or the text left of each row; `x_title`
        stands below. `span` is the (first, last) time, `gap` the share of the width between two columns."""
        n, rows = len(titles), max(1, -(-len(titles) // columns))
        if isinstance(y_titles, str):
            y_titles = ["" if i % columns else y_titles for i in range(n)]
        gap_x, height = gap if columns > 1 else 0.0, self.layout["height"]
        inner = height - self.layout["margin"]["t"] - self.layout["margin"]["b"]
        gap_y = 52 / inner if rows > 1 else 0.0
        if columns > 3 and any(titles):  # the title of the last panel is wider than a narrow page's panel
            self.layout["margin"]["r"] = max(self.layout["margin"]["r"], 40)
        w, h = (1 - gap_x * (columns - 1)) / columns, (1 - gap_y * (rows - 1)) / rows
        for i in range(n):
            r, c = divmod(i, columns)
            x0, y1 = c * (w + gap_x), 1 - r * (h + gap_y)
            xa = style_axis(x_title if i + columns >= n else "", domain=[x0, x0 + w], anchor=place(i + 1)["yaxis"])
            if span is not None:
                xa["range"] = list(span)
            self.layout[axis("xaxis", i + 1)] = xa
            up = {"domain": [max(0.0, y1 - h), y1], "anchor": place(i + 1)["xaxis"]}
            self.layout[axis("yaxis", i + 1)] = style_axis(y_titles[i], **up)
            if titles[i]:
                self.label(f"<b>{titles[i]}</b>", x0, y1, xanchor="left", font={"size": 12, "color": "--ink"})

    def label(self, text: str, x: float, y: float, **more: Any) -> None:
        """Write a text just above the place (x, y) of the drawing, in shares of its size."""
        at = {"xref": "paper", "yref": "paper", "x": x, "y": y, "yanchor": "bottom", "yshift": 3, "showarrow": False}
        self.layout["annotations"].append({"text": text, **at, **more})

    def bands(self, intervals: Any, panels: Any) -> None:
        """Shade [(from, to)] in panels 1..`panels`."""
        for panel in range(1, panels + 1):
            at = place(panel)
            for a, b in intervals:
                ends = {"xref": at["xaxis"], "yref": at["yaxis"] + " domain", "x0": a, "x1": b, "y0": 0, "y1": 1}
                look = {"fillcolor": "--fault/0.10", "line": {"width": 0}, "layer": "below"}
                self.layout["shapes"].append({"type": "rect", **ends, **look})

    def least(self, panel: Any, curves: Any, half: float) -> Any:
        """Give a panel a vertical range around `curves` of at least +-`half`: noise must not fill it."""
        ends = [(y.min(where=ok, initial=np.inf), y.max(where=ok, initial=-np.inf))
                for y in curves for ok in [np.isfinite(y)] if ok.any()] or [(0.0, 0.0)]  # fmt: skip
        low, high = float(min(a for a, _ in ends)), float(max(b for _, b in ends))
        middle, spread = (high + low) / 2, max(1.12 * (high - low) / 2, half)
        self.layout[axis("yaxis", panel)]["range"] = [middle - spread, middle + spread]

    def level(self, panel: int, y: float) -> None:
        """Draw a horizontal line at `y` through a panel: a threshold."""
        at, line = place(panel), {"color": "--fault", "width": 1.2, "dash": "dash"}
        ends = {"xref": at["xaxis"] + " domain", "yref": at["yaxis"], "x0": 0, "x1": 1, "y0": y, "y1": y}
        self.layout["shapes"].append({"type": "line", **ends, "line": line})

    def plain(self) -> dict:
        """Return what the page's script reads."""
        out = {"id": self.id, "data": self.data, "layout": self.layout, "time": self.time}
        return out | {k: getattr(self, k) for k in ("detector", "rows", "track") if getattr(self, k) is not None}


def packed(values: Any) -> dict[str, str]:
    """Return an array as plotly.js takes it: little-endian float32 in base64."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.asarray(values, "<f4").tobytes()).decode()}


def envelope(y: np.ndarray, points: int = thinned.POINTS) -> tuple[np.ndarray, float]:
    """Return (values, samples per value) of a curve as it is drawn (cosim/replay/thinned.py)."""
    made, every = thinned.envelope(len(y), points)
    return made.add(np.asarray(y)[:, None]).values()[:, 0], every


def place(panel: Any) -> dict[str, str]:
    """Return the axes of panel number `panel` (1, 2, ...)."""
    tail = "" if panel == 1 else str(panel)
    return {"xaxis": "x" + tail, "yaxis": "y" + tail}


def axis(key: str, panel: Any) -> str:
    """Return the layout's name of an axis: xaxis, xaxis2, ..."""
    return key if panel == 1 else f"{key}{panel}"


def base(height: float, legend: bool = True) -> dict[str, Any]:
    """Return the layout that all figures share."""
    return {
        "height": height,
        "autosize": True,
        "margin": {"l": 62, "r": 14, "t": 34 if legend else 26, "b": 34},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "hovermode": "x unified",
        "dragmode": "zoom",
        "font": {
            "family": "system-ui, -apple-system, Segoe UI, Roboto, Noto Sans, Liberation Sans, sans-serif",
            "size": 12,
            "color": "--ink",
        },
        "hoverlabel": {"bgcolor": "--card", "bordercolor": "--line", "font": {"color": "--ink", "size": 11}},
        "legend": {
            **{"orientation": "h", "x": 1, "xanchor": "right", "y": 1.0, "yanchor": "bottom", "font": {"size": 11}},
            **{"bgcolor": "rgba(0,0,0,0)", "itemclick": False, "itemdoubleclick": False},
        },
        "showlegend": legend,
        "shapes": [],
        "annotations": [],
    }


def still(name: str, caption: str, height: int, legend: bool = False, hover: str = "closest", **more: Any) -> Figure:
    """Return a Figure that does not follow time, of the shared layout; `more` are fields of Figure."""
    return Figure(name, caption, height, layout=base(height, legend) | {"hovermode": hover}, time=False, **more)


def log_axis(low: float, high: float, marks: Sequence[float] = (1,)) -> dict[str, Any]:
    """Return what makes an axis logarithmic from `low` to `high`, with a label at each of `marks` per decade."""
    shown = [v * 10.0**e for e in range(-6, 9) for v in marks if low <= v * 10.0**e <= high]
    about = {"tickvals": shown, "ticktext": [f"{v:g}" for v in shown]}
    return {"type": "log", "range": [math.log10(low), math.log10(high)], **about}


def style_axis(title: str = "", **more: Any) -> dict[str, Any]:
    """Return one axis in the house style."""
    return {
        "title": {"text": title, "font": {"size": 11, "color": "--muted"}, "standoff": 4}, "gridcolor": "--grid",
        "zeroline": False, "linecolor": "--line", "tickcolor": "--line", "ticks": "outside", "ticklen": 3,
        "tickfont": {"size": 10.5, "color": "--muted"}, "automargin": False, "exponentformat": "power",
        "separatethousands": True, "minexponent": 6, **more,
    }  # fmt: skip
