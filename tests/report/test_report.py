"""The report of a flight: one file that opens offline, shows what the log holds, and says what the result says."""

import json
import math
import re

import numpy as np
import pytest
from report_browser import CHROMIUM, use

from cosim.errors import LogError, OutputError
from cosim.flight.simulate import simulate
from cosim.judge.lanes import part
from cosim.log import open_log
from cosim.replay.recording import LoggedFlight, joined
from cosim.replay.thinned import POINTS, peaks
from cosim.report import flight_report
from cosim.report.figure import envelope
from cosim.report.flight_page import render
from cosim.scenario import load_scenario

OFC = ("duration_s=9", "faults.0.start_s=4", "faults.0.amplitude_mm=4")
LOCAL = "detectors.enabled=['rfafe','iotsekf','rtsekf_flight','ema_kalman','ema_kalman_flight','position_monitor']"


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Return (log, result) of a short oscillation with a level of each kind."""
    log = tmp_path_factory.mktemp("report") / "ofc.mcap"
    return log, simulate(load_scenario("liquid-ofc", [*OFC, LOCAL]), log=log)


@pytest.fixture(scope="module")
def page(flight, tmp_path_factory):
    return flight_report(flight[0], tmp_path_factory.mktemp("page") / "ofc.html")


@pytest.fixture(scope="module")
def text(page):
    return page.read_text("utf-8")


def figures(text):
    """Return {id: what the page's script draws}."""
    data = json.loads(re.search(r'id="figures">(.*?)</script>', text, re.S).group(1).replace("<\\/", "</"))
    return {figure["id"]: figure for figure in data["figures"]}


def coloured(value):
    """Replace names of CSS variables by a colour, as the page's script does."""
    if isinstance(value, str):
        return "#123456" if value.startswith("--") else value
    if isinstance(value, list):
        return [coloured(v) for v in value]
    return {k: coloured(v) for k, v in value.items() if k != "detector"} if isinstance(value, dict) else value


def test_page_is_one_file_below_8_mb_that_asks_for_nothing_else(page, text):
    assert page.stat().st_size < 8e6
    ours = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:)|@import|url\(""", ours)


def test_every_figure_is_valid_by_plotlys_own_schema_and_has_no_empty_panel(text):
    import plotly.graph_objects as go

    assert len(figures(text)) >= 10
    for name, figure in figures(text).items():
        made = go.Figure(coloured({"data": figure["data"], "layout": figure["layout"]}))
        assert len(made.data) == len(figure["data"]) > 0
        panels = {k.replace("axis", "") for k in figure["layout"] if k.startswith("xaxis")}
        assert panels == {t.get("xaxis") for t in figure["data"]}, name


def test_every_detector_has_a_figure_and_a_toggle_and_each_lane_but_the_quiet_ones_a_row(flight, text):
    told = flight[1].detectors
    ids = {d["id"] for d in told}
    assert {f["detector"] for f in figures(text).values() if "detector" in f} == ids
    assert set(re.findall(r'data-toggle="(\w+)"', text)) == ids
    assert set(re.findall(r'class="chip \w+ on" data-toggle="(\w+)"', text)) == {d["id"] for d in told if d["alarm"]}
    rows = [r for r in figures(text)["timeline"]["rows"] if r["detector"]]
    quiet = [d for d in told if not d["concerned"] and not d["alarm"]]
    assert len(rows) == len(told) - len(quiet) and f"{len(quiet)} lanes of healthy parts stayed quiet" in text
    assert all(re.search(rf"<b>{d['id']}</b></td><td>{part(d)}<", text) for d in told)


def test_the_time_line_tells_the_last_name_of_the_longest_alarm_and_when_it_came(flight, text):
    notes = [a for a in figures(text)["timeline"]["layout"]["annotations"] if "detector" in a]
    labels = {a["y"]: a["text"] for a in notes}
    named = [d for d in flight[1].detectors if d["isolated"] and d["alarm_share"] == 1.0 and not d["false_alarms"]]
    late = [d for d in named if d["named_at_s"] > d["detected_at_s"] + 1e-9]
    assert late
    for d in late:
        label = labels[d["id"] if d["target"] == "aircraft" else f"{d['id']} {part(d)}"]
        assert label.endswith(f" from {d['named_at_s']:.2f} s"), label
    # the published filter of the motors: a tick's alarm with another name stands before the one that stays
    for d in (d for d in flight[1].detectors if d["id"] == "ema_kalman"):
        assert d["false_alarms"] > 1
        assert labels[f"ema_kalman {part(d)}"].startswith(f"{d['isolated']['class']} {part(d, d)}")


def test_faults_of_one_kind_on_several_parts_have_a_row_each(tmp_path):
    two = ["faults.0={target='sensor.alpha', kind='dropout', start_s=0.5}", "detectors.enabled=[]", "duration_s=1",
           "faults.1={target='sensor.cas', kind='dropout', start_s=0.2}", "elevator.feedback=measured"]  # fmt: skip
    simulate(load_scenario("cruise", two), log=tmp_path / "two.mcap")
    rows = figures(render(LoggedFlight(tmp_path / "two.mcap")))["timeline"]["rows"]
    assert [r["name"] for r in rows] == ["fault: dropout, sensor.alpha", "fault: dropout, sensor.cas"]


def test_lanes_are_judged_as_the_run_judged_them_with_the_same_estimation_error(flight):
    log, result = flight
    lanes = {(lane.id, lane.target): lane.entry for lane in LoggedFlight(log).lanes}
    for d in result.detectors:
        entry = lanes[d["id"], d["target"]]
        for key in ("alarm", "detected_at_s", "detection_delay_s", "isolated", "false_alarms"):
            assert entry[key] == d[key], (d["id"], d["target"], key)
        if d["estimate_rmse"] is not None:  # the run keeps single precision; nothing else may differ
            assert entry["estimate_rmse"] == pytest.approx(d["estimate_rmse"], rel=1e-4)
            assert entry["estimate_bias"] == pytest.approx(d["estimate_bias"], abs=1e-4 * d["estimate_rmse"])
    assert sum(d["estimate_rmse"] is not None for d in result.detectors) >= 2


def test_summary_and_table_say_who_noticed_when_with_one_delay(flight, text):
    box = re.sub(r"<[^>]+>", "", re.search(r'id="summary">(.*?)</section>', text, re.S).group(1))
    seen = next(d for d in flight[1].detectors if d["id"] == "iotsekf" and d["concerned"])
    assert "ofc_liquid on elevator.left_inner at valve, from 4 s" in box
    assert f"first alarm after {seen['detection_delay_s']:.2f} s by iotsekf" in box
    assert re.search(r"ema_kalman right inner: \d+ false alarm", box)
    heads = re.findall(r"<th([^>]*)>([^<]+)</th>", text)
    assert [name for _, name in heads][:4] == ["detector", "watches", "first alarm, s", "right name, s"]
    assert dict(map(reversed, heads))["|r| before"].count("more") == 1  # on demand
    row = next(r for r in re.findall(r"<tr.*?</tr>", text) if "<b>iotsekf</b>" in r and part(seen) in r)
    assert f">{seen['detection_delay_s']:.2f}</td>" in row


def test_sensor_fault_on_the_aircraft_has_its_truth_beside_the_estimate(tmp_path):
    log = tmp_path / "alpha.mcap"
    told = load_scenario("alpha-bias", ["duration_s=6", "faults.0.start_s=2", "detectors.enabled=['lpv_smo']"])
    simulate(told, log=log)
    lane = LoggedFlight(log).lanes[0]
    (truth, every), unit = lane.truth
    assert (lane.main, unit, every) == ("f_hat_alpha", "rad", 1.0) and truth[100] == 0.0
    assert truth[-1] == pytest.approx(math.radians(told.faults[0].model_extra["bias_deg"]))


@pytest.mark.parametrize("extra", [["detectors.enabled=['position_monitor']"],
                                   ["detectors.enabled=[]", "elevator.feedback='measured'"]])  # fmt: skip
def test_fault_free_flight_has_a_report_that_its_title_cannot_break(extra, tmp_path):
    change = ["duration_s=1", "title='</script><script>alert(1)</script>'", *extra]
    simulate(load_scenario("cruise", change), log=tmp_path / "f.mcap")
    text = render(LoggedFlight(tmp_path / "f.mcap"))
    assert "nothing: every alarm below is a false one" in text and figures(text) and "<script>alert" not in text


def test_log_that_was_cut_is_shown_as_far_as_it_goes_and_what_is_no_flight_refused(flight, tmp_path):
    whole, log = flight[0].read_bytes(), tmp_path / "cut.mcap"
    log.write_bytes(whole[: len(whole) // 2])
    text = render(LoggedFlight(log))
    assert "incomplete: the log ends early" in text and "Parts of the log are lost" in text
    begins = [c.offset for c in open_log(flight[0]).chunks]
    hole = bytearray(whole)
    hole[begins[2] + 100] ^= 1  # what is said after it would be judged at a wrong time
    log.write_bytes(hole)
    assert LoggedFlight(log).end == 1.995 and "incomplete: the log ends early" in render(LoggedFlight(log))
    hole[begins[0] + 100] ^= 1
    log.write_bytes(hole)
    with pytest.raises(LogError, match="no tick from the start"):
        LoggedFlight(log)
    log.write_bytes(b"nothing")
    with pytest.raises(LogError, match="not an MCAP file"):
        flight_report(log, tmp_path / "x.html")
    with pytest.raises(OutputError, match=r"folder is a file|cannot be written"):
        flight_report(flight[0], log / "x.html")


def test_reduced_curves_keep_every_peak_and_every_gap():
    y = np.sin(np.linspace(0, 300, 50_001))
    y[12_345], y[20_000], y[30_000:31_000] = 7.0, -9.0, np.nan
    values, every = envelope(y)
    assert len(values) <= POINTS + 2 and np.isnan(values).any()
    assert np.nanmax(values) == 7.0 and np.nanmin(values) == -9.0
    assert abs(int(np.nanargmax(values)) * every - 12_345) <= 2 * every
    thinned, every = peaks(7, points=3)
    largest = thinned.add(np.array([[1.0], [5.0]])).add(np.array([[2.0], *[[np.nan]] * 3, [3.0]])).values()[:, 0]
    assert every == 3 and largest[0] == 5.0 and np.isnan(largest[1]) and largest[2] == 3.0


def test_spans_are_joined_where_a_gap_cannot_be_drawn():
    assert joined([(0.0, 1.0), (1.1, 2.0), (2.5, 3.0), (3.01, 4.0)], 0.2) == [(0.0, 2.0), (2.5, 4.0)]


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_browser_draws_every_figure_and_cursor_zoom_toggles_and_theme_work(flight, page, text, tmp_path):
    found = use(page, tmp_path, width=700)
    assert found["errors"] == [] and found["requests"] == [] and not found["overflow"]
    assert [p["id"] for p in found["plots"]] == list(figures(text))
    assert all(p["svg"] and p["traces"] and p["marks"] and p["width"] > 300 for p in found["plots"])
    assert found["theme"][0] != found["theme"][1] and found["theme"][2] != found["theme"][3]
    toggle, cursor = found["toggle"], found["cursor"]
    assert toggle["before"] == toggle["on"] > 0 and toggle["off"] == 0 and toggle["pressed"] == "false"
    lanes = sum(r["detector"] == toggle["id"] for r in figures(text)["timeline"]["rows"])
    assert toggle["rows_before"] - toggle["rows_off"] == lanes and toggle["rows_on"] == toggle["rows_before"]
    assert float(cursor["text"].split()[2]) == pytest.approx(cursor["expected"], abs=0.1)
    assert cursor["hairs"] > 20 and cursor["spots"] == 2 and "no fault" in cursor["now"]
    assert found["zoom"] == [[1, 2], [1, 2]]
