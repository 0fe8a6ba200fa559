"""Arrange a log's signals for the viewers: a Foxglove layout (JSON) and a PlotJuggler layout (XML), from its topics.

Put them into the log as attachments, or write them beside it; both viewers import a layout by hand.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import cycle, starmap
from typing import Any
from xml.etree import ElementTree

# page -> plots (title, group of topics or "" for any, names of fields or their beginnings before "*")
PAGES = (
    ("Flight", (
        ("Angle of attack, pitch [rad]", "truth", ("alpha", "theta")),
        ("Rates [rad/s]", "truth", ("p", "q", "r")),
        ("Load factor [-]", "truth", ("nz",)),
        ("Altitude [m]", "truth", ("h",)),
        ("Speed [m/s]", "truth", ("tas", "cas")),
    )),
    ("Elevators", (
        ("Surfaces [rad]", "truth", ("de_*",)),
        ("Rods [m]", "actuators", ("q_rod", "q", "x_rod", "rod*")),
        ("Commands", "actuators", ("u*", "cmd*", "ref*")),
    )),
    ("Detectors", (
        ("Test statistic, alarm at 1 [-]", "detectors", ("r",)),
        ("Alarm [-]", "detectors", ("alarm",)),
        ("Verdict [code]", "detectors", ("verdict",)),
        ("Estimated fault", "detectors", ("f_hat*",)),
        ("Injected fault", "", ("active", "signal", "injected*")),
    )),
)  # fmt: skip
STEERING = ("Inject and heal", (  # beside the services of a live flight
    ("Load factor [-]", "truth", ("nz",)),
    ("Surfaces [rad]", "truth", ("de_*",)),
    ("Alarm [-]", "detectors", ("alarm",)),
))  # fmt: skip
_COLOURS = ("#1f77b4", "#d62728", "#1ac938", "#ff7f0e", "#f14cc1", "#9467bd", "#17becf", "#bcbd22")


def viewer_layouts(topics: Sequence[Any], pages: Any = PAGES) -> dict[str, Any]:
    """Return {"layout.foxglove.json": (media type, bytes), "layout.plotjuggler.xml": ...} for Topics.

    `pages` say what stands together; a plot, or a page, for which the topics have no field is left out.
    """
    found = _drawn(topics, pages)
    return {
        "layout.foxglove.json": ("application/json", json.dumps(_foxglove(found), indent=1).encode()),
        "layout.plotjuggler.xml": ("application/xml", _plotjuggler(found)),
    }


def live_layout(topics: Sequence[Any], requests: Mapping[str, Mapping]) -> bytes:
    """Return the Foxglove layout (JSON) of a live flight: the log's, and first a page to break and mend the flight.

    `requests` {service: a first request} has a panel each, filled in; none, no such page.
    """
    layout = _foxglove(_drawn(topics, PAGES))
    seen = [_plot(title, signals) for _, plots in _drawn(topics, (STEERING,)) for title, signals in plots]
    calls = [
        _panel("ServiceCall", {"serviceName": f"/{name}", "requestPayload": json.dumps(keys, indent=1),
                               "layout": "vertical", "buttonText": name.capitalize()}, title=name.capitalize())
        for name, keys in requests.items()
    ]  # fmt: skip
    if requests:
        sides = [_split("column", calls), _split("column", seen)]
        layout["content"]["tabs"].insert(0, {"title": "Inject and heal", "content": _split("row", sides)})
    return json.dumps(layout, indent=1).encode()


def _drawn(topics, pages):
    """Return [(page, [(title, signals)])] of the plots for which there are signals."""
    found = []
    for page, plots in pages:
        drawn = [(title, _signals(topics, group, names)) for title, group, names in plots]
        drawn = [(title, signals) for title, signals in drawn if signals]
        if drawn:
            found.append((page, drawn))
    return found


def _signals(topics, group, names):
    """Return [(name in PlotJuggler, path in Foxglove)] of every field that one of the names fits."""
    exact, begin = {n for n in names if "*" not in n}, tuple(n.rstrip("*") for n in names if n.endswith("*"))
    return [(f"{t.name}/{field}", f"{t.channel}{t.name[len(t.channel) :].replace('/', '.')}.{field}")
            for t in topics if not group or t.group == group for field in t.fields
            if field in exact or (begin and field.startswith(begin))]  # fmt: skip


def _foxglove(pages):
    drawn = [(page, _split("column", starmap(_plot, plots))) for page, plots in pages]
    drawn.append(("Place", _split("row", [_panel("ThreeDee")])))
    tabs = [{"title": title, "content": content} for title, content in drawn]
    return {"version": 1, "content": {"type": "tabs", "selectedTabIndex": 0, "tabs": tabs}}


def _split(direction, contents):
    return {"type": "split", "direction": direction, "items": [{"proportion": 1, "content": c} for c in contents]}


def _panel(kind, config=None, **more):
    return {"type": "panel", "panelType": kind, "config": config or {}, **more, "version": 1}


def _plot(title, signals):
    paths = [{"value": path, "timestampMethod": "publishTime"} for _, path in signals]
    return _panel("Plot", {"paths": paths}, title=title)


def _plotjuggler(pages):
    root = ElementTree.Element("root")
    tabs = ElementTree.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for page, plots in pages:
        tab = ElementTree.SubElement(tabs, "Tab", containers="1", tab_name=page)
        count, sizes = str(len(plots)), ";".join([f"{1 / len(plots):.6f}"] * len(plots))
        container = ElementTree.SubElement(tab, "Container")
        splitter = ElementTree.SubElement(container, "DockSplitter", orientation="-", sizes=sizes, count=count)
        for title, signals in plots:
            area = ElementTree.SubElement(splitter, "DockArea", name=title)
            drawn = {"mode": "TimeSeries", "style": "Lines", "flip_x": "false", "flip_y": "false"}
            plot = ElementTree.SubElement(area, "plot", drawn)
            ElementTree.SubElement(plot, "limitY")
            for (name, _), colour in zip(signals, cycle(_COLOURS)):
                ElementTree.SubElement(plot, "curve", name=name, color=colour)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
