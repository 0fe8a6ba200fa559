"""The viewers' layouts name signals that the log has, in the form that each viewer reads."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest

from cosim.log import Topic
from cosim.log.layouts import live_layout, viewer_layouts

OUTPUTS = {"iotsekf": ("r", "alarm", "f_hat_u"), "monitor": ("r", "alarm")}
TOPICS = [
    Topic("/truth/aircraft", ("alpha", "q", "nz", "h", "de_li"), ("",) * 5, np.arange(5), 1, "truth", "/truth"),
    *(
        Topic(
            f"/detectors/{name}/left_inner",
            fields,
            ("",) * len(fields),
            np.arange(len(fields)),
            1,
            "detectors",
            f"/detectors/{name}",
        )
        for name, fields in OUTPUTS.items()
    ),
]


def test_every_path_of_the_foxglove_layout_is_a_signal_of_the_log():
    layout = json.loads(viewer_layouts(TOPICS)["layout.foxglove.json"][1])
    assert [tab["title"] for tab in layout["content"]["tabs"]] == ["Flight", "Elevators", "Detectors", "Place"]
    plots = {
        item["content"]["title"]: [p["value"] for p in item["content"]["config"]["paths"]]
        for tab in layout["content"]["tabs"]
        for item in tab["content"]["items"]
        if item["content"]["panelType"] == "Plot"
    }
    assert plots["Alarm [-]"] == ["/detectors/iotsekf.left_inner.alarm", "/detectors/monitor.left_inner.alarm"]
    known = {f"{t.channel}.{t.name.rpartition('/')[2]}.{f}" for t in TOPICS for f in t.fields}
    assert all(paths and set(paths) <= known for paths in plots.values())
    assert "Verdict [code]" not in plots


def test_the_plotjuggler_layout_has_the_same_pages():
    root = ElementTree.fromstring(viewer_layouts(TOPICS)["layout.plotjuggler.xml"][1])
    assert [tab.get("tab_name") for tab in root.iter("Tab")] == ["Flight", "Elevators", "Detectors"]
    assert "/detectors/iotsekf/left_inner/f_hat_u" in [c.get("name") for c in root.iter("curve")]
    for splitter in root.iter("DockSplitter"):
        assert len(splitter) == int(splitter.get("count")) == len(splitter.get("sizes").split(";"))


def test_a_live_layout_has_a_filled_panel_per_service_as_the_sdk_builds_one():
    sdk = pytest.importorskip("foxglove.layouts", reason="foxglove-sdk is an extra (live)")
    first, *rest = json.loads(live_layout(TOPICS, {"heal": {"fault": 0}}))["content"]["tabs"]
    assert rest == json.loads(viewer_layouts(TOPICS)["layout.foxglove.json"][1])["content"]["tabs"]
    config = sdk.ServiceCallConfig(
        service_name="/heal", request_payload='{\n "fault": 0\n}', layout="vertical", button_text="Heal"
    )
    call = sdk.ServiceCallPanel(title="Heal", config=config)
    split = sdk.SplitContainer(direction="column", items=[sdk.SplitItem(content=call)])
    layout = json.loads(sdk.Layout(content=sdk.TabContainer(tabs=[sdk.TabItem(title="a", content=split)])).to_json())
    (expected,) = layout["content"]["tabs"][0]["content"]["items"]
    (made,) = first["content"]["items"][0]["content"]["items"]
    assert made == expected
    assert live_layout(TOPICS, {}) == viewer_layouts(TOPICS)["layout.foxglove.json"][1]
