"""A Figure of a flight as SVG for a page without plotly.js: curves, bands and texts of the same data and layout."""

import base64
import html
import math
import re
from importlib.resources import files

import numpy as np

from cosim.report.figure import Figure, axis, envelope

WIDTH = 1132  # of a figure, in the units of its viewBox: that of the page's text
TITLE = 24  # height of a still picture's title
FONT = "system-ui,Segoe UI,Roboto,Liberation Sans,sans-serif"  # page.py knows a picture of ours by it
LETTER = 0.56  # width of a letter as a share of the font's size, on average
DASHED = {"dash": "6 4", "dot": "1.5 3", "dashdot": "6 3 1.5 3"}
# of a share: cividis (Nunez, Anderton, Renslow 2018) at eighths, read alike with and without colour vision
STOPS = np.array([[0, 34, 78], [18, 53, 112], [59, 73, 108], [87, 93, 109], [112, 113, 115], [138, 134, 120],
                  [165, 156, 116], [195, 179, 105], [254, 232, 56]])  # fmt: skip


def drawn(figure: Figure) -> str:
    """Return the figure as an `<svg>` element; its parts carry `data-detector` where page.js hides them."""
    layout = {**figure.layout, "yaxis": dict(figure.layout.get("yaxis", {}))}
    if figure.rows:
        layout["yaxis"] |= {"categoryarray": [r["name"] for r in figure.rows], "range": [len(figure.rows) - 0.4, -0.6]}
    height = layout["height"]
    panels = {i: _Panel(figure, layout, i) for i in (int(k[5:] or 1) for k in layout if k.startswith("xaxis"))}
    out = [p.frame() for p in panels.values()]
    out += [_shape(panels, s) for s in layout["shapes"] if s.get("layer") == "below"]
    at = None
    for trace in figure.data:
        panel = panels[_number(trace)]
        at, text = (None, _cells(panel, trace)) if trace["type"] == "heatmap" else _drawn(panel, trace, at)
        out.append(text)
    out += [_shape(panels, s) for s in layout["shapes"] if s.get("layer") != "below"]
    out += [_note(panels, layout, a) for a in layout["annotations"]]
    out += _legend(layout, figure.data) if layout.get("showlegend") else []
    font = 'font-family="var(--font)" font-size="11" fill="var(--ink)"'
    return (f'<svg class="drawn" viewBox="0 0 {WIDTH} {height:g}" role="img" {font}>'
            f"<title>{html.escape(figure.caption or figure.id)}</title>{''.join(out)}</svg>")  # fmt: skip


def still(figure: Figure, title: str) -> str:
    """Return the figure as a file of its own, for a README: its title above it, in the light colours of the page."""
    light = files("cosim.report").joinpath("page.css").read_text(encoding="utf-8").partition("[data-theme")[0]
    colours = dict(re.findall(r"(--\w+): ([^;]+);", light)) | {"--font": FONT}
    inner = re.sub(r"var\((--\w+)\)", lambda m: colours[m[1]], drawn(figure))
    high = figure.layout["height"] + TITLE
    box = f'viewBox="0 {-TITLE} {WIDTH} {high:g}"'
    head = (f'<svg xmlns="http://www.w3.org/2000/svg" {box} width="{WIDTH}" height="{high:g}" font-family="{FONT}">'
            f'<rect y="{-TITLE}" width="{WIDTH}" height="{high:g}" fill="{colours["--page"]}"/>'
            f'<text x="4" y="-8" font-size="13" font-weight="600">{html.escape(title)}</text>')  # fmt: skip
    return f'{head}<svg width="{WIDTH}" height="{high - TITLE:g}"{inner.removeprefix("<svg")}</svg>\n'


def _number(trace):
    return int(trace["yaxis"][1:] or 1)


def _values(given):
    """Return an array, unpacked where it is base64 single precision."""
    if isinstance(given, dict):
        return np.frombuffer(base64.b64decode(given["bdata"]), "<f4").astype(float)
    return np.array([math.nan if v is None else v for v in given], float)


def _colour(name, paint="stroke"):
    """Return the attributes of a colour: "--blue", "--blue/0.2" or one of CSS."""
    value, _, alpha = name.partition("/") if name.startswith("--") else (name, "", "")
    value = f"var({value})" if value.startswith("--") else value
    return f'{paint}="{value}"' + (f' {paint}-opacity="{alpha}"' if alpha else "")


def _of(detector):
    return f' data-detector="{html.escape(detector)}"' if detector else ""


class _Axis:
    """One axis: from a value to a place on the drawing between `start` and `end`."""

    def __init__(self, about, values, start, end):
        self.about, self.start, self.end = about, start, end
        self.names = list(about.get("categoryarray", ())) if about.get("type") == "category" else None
        self.log = about.get("type") == "log"
        if "range" in about:
            self.low, self.high = about["range"]
        else:
            found = self._scaled(np.concatenate([*values, np.zeros(0)]))
            found = found[np.isfinite(found)]
            low, high = (found.min(), found.max()) if len(found) else (0.0, 1.0)
            more = 0.05 * (high - low) or 1.0
            self.low, self.high = low - more, high + more

    def _scaled(self, v):
        if not self.log:
            return v
        with np.errstate(all="ignore"):
            return np.log10(v)

    def at(self, v):
        """Return the places of values, or of names on an axis of names."""
        if self.names is not None:
            v = [self.names.index(n) if n in self.names else math.nan for n in v]
        share = (self._scaled(np.asarray(v, float)) - self.low) / (self.high - self.low)
        return self.start + share * (self.end - self.start)

    def ticks(self):
        """Return [(place, text)]."""
        if self.names is not None:
            return list(zip(self.at(self.names), self.names))
        low, high = sorted((self.low, self.high))
        if "tickvals" in self.about:
            values, told = self.about["tickvals"], self.about["ticktext"]
        else:
            rough = (high - low) / max(3.0, abs(self.end - self.start) / 90.0)
            unit = 10.0 ** math.floor(math.log10(rough))
            step = unit * max(n for n in (1, 2, 5) if n * unit <= rough)
            values = [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
            told = [f"{v:,.10g}" if 1e4 <= abs(v) < 1e7 else f"{v:.6g}" for v in values]
        least, most = sorted((self.start, self.end))
        return [(p, t) for p, t in zip(self.at(values), told) if least - 0.5 <= p <= most + 0.5]


class _Panel:
    """One pair of axes."""

    def __init__(self, figure, layout, number):
        m, self.number, self.id = layout["margin"], number, f"{figure.id}-{number}"
        xa, ya = layout.get(axis("xaxis", number), {}), layout.get(axis("yaxis", number)) or layout["yaxis"]
        inner = WIDTH - m["l"] - m["r"], layout["height"] - m["t"] - m["b"]
        x0, x1 = (m["l"] + d * inner[0] for d in xa.get("domain", (0, 1)))
        y1, y0 = (m["t"] + (1 - d) * inner[1] for d in ya.get("domain", (0, 1)))
        mine = [t for t in figure.data if _number(t) == number]
        at = {key: [_values(t[key]) for t in mine if key in t and about.get("type") != "category"]
              for key, about in (("x", xa), ("y", ya))}  # fmt: skip
        self.x, self.y = _Axis(xa, at["x"], x0, x1), _Axis(ya, at["y"], y1, y0)
        self.box = x0, y0, x1 - x0, y1 - y0

    def frame(self):
        """Draw grid, ticks and titles."""
        x, y, w, h = self.box
        box = f'x="{x:.1f}" y="{y:.1f}" width="{w:.1f}" height="{h:.1f}"'
        out = [f'<clipPath id="c-{self.id}"><rect {box}/></clipPath>']
        for p, told in self.x.ticks():
            out.append(f'<path d="M{p:.1f} {y + h:.1f}v{-h:.1f}" stroke="var(--grid)"/>'
                       f'<text x="{p:.1f}" y="{y + h + 14:.1f}" text-anchor="middle" fill="var(--muted)">{told}</text>')
        for p, told in self.y.ticks():
            lines = "" if self.y.names is not None else f'<path d="M{x:.1f} {p:.1f}h{w:.1f}" stroke="var(--grid)"/>'
            out.append(f'{lines}<text x="{x - 6:.1f}" y="{p + 4:.1f}" text-anchor="end" '
                       f'fill="var(--muted)">{html.escape(str(told))}</text>')
        words = [a.about.get("title", {}).get("text", "") for a in (self.x, self.y)]
        out.append(f'<text x="{x + w / 2:.1f}" y="{y + h + 29:.1f}" text-anchor="middle" fill="var(--muted)">'
                   f"{html.escape(words[0])}</text>" if words[0] else "")
        out.append(f'<text transform="translate({x - 47:.1f} {y + h / 2:.1f}) rotate(-90)" text-anchor="middle" '
                   f'fill="var(--muted)">{html.escape(words[1])}</text>' if words[1] else "")
        return "".join([*out, f'<path d="M{x:.1f} {y:.1f}v{h:.1f}h{w:.1f}" fill="none" stroke="var(--line)"/>'])


def _drawn(panel, trace, before):
    """Return (places of a trace (n, 2), the trace as SVG text); `before` are those of the last one, for a band."""
    y = trace["y"] if panel.y.names is not None else _values(trace["y"])
    if "x" in trace:
        x = trace["x"] if panel.x.names is not None else _values(trace["x"])
    else:
        most, every = int(0.75 * panel.box[2]), 1.0
        if len(y) > 1.2 * most:
            y, every = envelope(y, most)
        x = trace["x0"] + trace["dx"] * every * np.arange(len(y))
    at, line, out = np.stack([panel.x.at(x), panel.y.at(y)], axis=1), trace["line"], ""
    if trace.get("fill") == "tonexty":
        ring = np.concatenate([before, at[::-1]])
        ring = ring[np.isfinite(ring).all(axis=1)]
        out = f'<path d="{_path(ring)}" stroke="none" {_colour(trace["fillcolor"], "fill")}/>'
    if line["width"]:
        dash = DASHED.get(line.get("dash", "solid"), "")
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        out += f'<path d="{_path(at)}" fill="none" {_colour(line["color"])} stroke-width="{line["width"]:g}"{dashed}/>'
    return at, f'<g clip-path="url(#c-{panel.id})"{_of((trace.get("meta") or {}).get("detector"))}>{out}</g>'


def _cells(panel, trace):
    """Draw the shares (rows, columns) of a heat map over two axes of names, those that have a text."""
    x, y = panel.x.at(trace["x"]), panel.y.at(trace["y"])
    w, h, out = panel.box[2] / len(x), panel.box[3] / len(y), []
    for (i, j), share in np.ndenumerate(trace["z"]):
        if told := trace["text"][i][j]:
            red, green, blue = (np.interp(8.0 * share, range(9), stop) for stop in STOPS.T)
            paint = f'fill="#{round(red):02x}{round(green):02x}{round(blue):02x}"'
            box = f'x="{x[j] - w / 2:.1f}" y="{y[i] - h / 2:.1f}" width="{w - 0.7:.1f}" height="{h - 0.7:.1f}"'
            out.append(f'<rect {box} {paint}/><text x="{x[j]:.1f}" y="{y[i] + 3:.1f}" text-anchor="middle" '
                       f'font-size="9" fill="{"#fff" if share < 0.5 else "#1c2128"}">{told}</text>')  # fmt: skip
    return "".join(out)


def _path(at):
    """Return points (n, 2) as a path of relative steps in tenths; it breaks at NaN, and a flat run is one step."""
    q, out, x, y = np.round(10.0 * np.clip(at, -1e5, 1e5)), [], 0, 0
    whole, up = np.isfinite(q).all(axis=1), True
    for k in range(len(q)):
        if not whole[k]:
            up = True
            continue
        a, b = int(q[k, 0]), int(q[k, 1])
        flat = not up and 0 < k < len(q) - 1 and whole[k + 1] and q[k - 1, 1] == b == q[k + 1, 1]
        if flat or (not up and a == x and b == y):
            continue
        out.append(f"M{a / 10:g} {b / 10:g}" if up else f"l{(a - x) / 10:g} {(b - y) / 10:g}")
        x, y, up = a, b, False
    return re.sub(r"(?<=[l -])0\.", ".", "".join(out).replace(" -", "-"))


def _spot(panels, ref, value, along, layout=None):
    """Return the place of a shape's or text's coordinate: of the paper, a panel's box, or an axis."""
    name, _, domain = ref.partition(" ")
    if name == "paper":
        m = layout["margin"]
        if along == "x":
            return m["l"] + value * (WIDTH - m["l"] - m["r"])
        return m["t"] + (1 - value) * (layout["height"] - m["t"] - m["b"])
    panel = panels[int(name[1:] or 1)]
    own = panel.x if along == "x" else panel.y
    if domain:
        return own.start + value * (own.end - own.start)
    return float(own.at([value])[0])


def _shape(panels, s):
    x0, x1 = (_spot(panels, s["xref"], s[k], "x") for k in ("x0", "x1"))
    y0, y1 = (_spot(panels, s["yref"], s[k], "y") for k in ("y0", "y1"))
    clip = f' clip-path="url(#c-{panels[int(s["xref"].partition(" ")[0][1:] or 1)].id})"'
    if s["type"] == "rect":
        box = min(x0, x1), min(y0, y1), abs(x1 - x0), abs(y1 - y0)
        return '<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" '.format(*box) + \
               f'{_colour(s["fillcolor"], "fill")}{clip}/>'  # fmt: skip
    dash = DASHED.get(s["line"].get("dash", ""), "")
    return f'<path d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}" {_colour(s["line"]["color"])} ' \
           f'stroke-width="{s["line"]["width"]:g}" stroke-dasharray="{dash}"{clip}/>'  # fmt: skip


def _note(panels, layout, a):
    """Draw a text; `<b>` in it makes all of it bold."""
    x, y = (_spot(panels, a[f"{k}ref"] if f"{k}ref" in a else k, a[k], k, layout) if not isinstance(a[k], str)
            else float(panels[1].y.at([a[k]])[0]) for k in ("x", "y"))  # fmt: skip
    font = {"size": 12, "color": "--ink", **a.get("font", {})}
    x, y = x + a.get("xshift", 0), y - a.get("yshift", 0)
    y += {"bottom": -2, "top": font["size"]}.get(a.get("yanchor", "middle"), 0.36 * font["size"])
    side = {"left": "start", "right": "end"}.get(a.get("xanchor", "center"), "middle")
    bold = ' font-weight="600"' if "<b>" in a["text"] else ""
    told = html.escape(re.sub(r"</?b>", "", a["text"]))
    behind = ""
    if "bgcolor" in a:
        size = font["size"]
        wide, high = LETTER * size * len(told) + 4, size + 4
        left = x - {"start": 2, "middle": wide / 2, "end": wide - 2}[side]
        box = f'x="{left:.1f}" y="{y - size:.1f}" width="{wide:.1f}" height="{high:g}"'
        behind = f'<rect {box} fill="var(--page)"{_of(a.get("detector"))}/>'
    return (f'{behind}<text x="{x:.1f}" y="{y:.1f}" text-anchor="{side}" font-size="{font["size"]:g}"{bold} '
            f'{_colour(font["color"], "fill")}{_of(a.get("detector"))}>{told}</text>')  # fmt: skip


def _legend(layout, data):
    """Draw the names of the curves in a line above the panels that ends at the right."""
    named = {t.get("legendgroup") or t["name"]: t for t in reversed(data) if t.get("showlegend") and t.get("name")}
    items, out = list(reversed(named.values())), []
    wide = [34 + LETTER * 11 * len(t["name"]) for t in items]
    x, y = WIDTH - layout["margin"]["r"] - sum(wide), _spot({}, "paper", layout["legend"]["y"], "y", layout) - 6
    for t, more in zip(items, wide):
        dash = DASHED.get(t["line"].get("dash", ""), "")
        out.append(f'<path d="M{x:.1f} {y - 4:.1f}h18" {_colour(t["line"]["color"])} stroke-width="2" '
                   f'stroke-dasharray="{dash}"/><text x="{x + 22:.1f}" y="{y:.1f}">{html.escape(t["name"])}</text>')
        x += more
    return out
