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
from cosim.replay.recording import LoggedFlight, joined, spans
from cosim.report import flight_report
from cosim.report.figure import POINTS, envelope, peaks
from cosim.report.flight_page import render
from cosim.scenario import load_scenario

OFC = ("duration_s=9", "faults.0.start_s=4", "faults.0.amplitude_mm=8")
LOCAL = "detectors.enabled=['rfafe','iotsekf','rtsekf_flight','ema_kalman','ema_kalman_flight','position_monitor']"


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Return (log, result) of a short oscillation with a level of each kind."""
    log = tmp_path_factory.mktemp("report") / "ofc.mcap"
    return log, simulate(load_scenario("liquid-ofc", [*OFC, LOCAL]), log=log)


@pytest.fixture(scope="module")
def page(flight, tmp_path_factory):
    return flight_report(flight[0], tmp_path_factory.mktemp("page") / "ofc.html")


def figures(text):
    """Return what the page's script draws."""
    return json.loads(re.search(r'id="figures">(.*?)</script>', text, re.S).group(1).replace("<\\/", "</"))["figures"]


def coloured(value):
    """Replace names of CSS variables by a colour, as the page's script does."""
    if isinstance(value, str):
        return "#123456" if value.startswith("--") else value
    if isinstance(value, list):
        return [coloured(v) for v in value]
    if isinstance(value, dict):
        return {k: coloured(v) for k, v in value.items() if k != "detector"}
    return value


def test_page_is_one_file_below_8_mb_that_asks_for_nothing_else(page):
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 8e6
    ours = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    assert not re.findall(r"""(?:src|href)\s*=\s*["'](?!data:)""", ours)
    assert not re.findall(r"@import|url\(", ours)


def test_every_figure_is_valid_by_plotlys_own_schema(page):
    import plotly.graph_objects as go

    drawn = figures(page.read_text(encoding="utf-8"))
    assert len(drawn) >= 10
    for figure in drawn:
        made = go.Figure(coloured({"data": figure["data"], "layout": figure["layout"]}))
        assert len(made.data) == len(figure["data"]) > 0


def test_every_detector_of_the_log_has_a_figure_a_toggle_and_a_row_on_the_time_line(flight, page):
    text = page.read_text(encoding="utf-8")
    ids = {d["id"] for d in flight[1].detectors}
    assert {f["detector"] for f in figures(text) if "detector" in f} == ids
    assert set(re.findall(r'data-toggle="(\w+)"', text)) == ids
    loud = {d["id"] for d in flight[1].detectors if d["alarm"]}
    assert set(re.findall(r'class="chip \w+ on" data-toggle="(\w+)"', text)) == loud < ids
    line = next(f for f in figures(text) if f["id"] == "timeline")
    assert len([r for r in line["rows"] if r["detector"]]) == len(flight[1].detectors)


def test_the_time_line_tells_when_the_name_came_where_it_came_after_the_alarm(flight, page):
    line = next(f for f in figures(page.read_text(encoding="utf-8")) if f["id"] == "timeline")
    labels = {a["y"]: a["text"] for a in line["layout"]["annotations"] if "detector" in a}
    held = [d for d in flight[1].detectors if d["isolated"] and d["alarm_share"] == 1.0 and not d["false_alarms"]]
    late = [d for d in held if d["named_at_s"] > d["detected_at_s"] + 1e-9]
    assert late
    for told in late:
        lane = told["target"].removeprefix("elevator.").replace("_", " ")
        label = labels[told["id"] if lane == "aircraft" else f"{told['id']} {lane}"]
        assert label.endswith(f" from {told['named_at_s']:.2f} s"), label


def test_faults_of_one_kind_on_several_parts_have_a_row_each(tmp_path):
    two = ["faults.0={target='sensor.alpha', kind='dropout', start_s=0.5}", "detectors.enabled=[]", "duration_s=1",
           "faults.1={target='sensor.cas', kind='dropout', start_s=0.2}", "elevator.feedback=measured"]  # fmt: skip
    simulate(load_scenario("cruise", two), log=tmp_path / "two.mcap")
    page = flight_report(tmp_path / "two.mcap", tmp_path / "two.html")
    line = next(f for f in figures(page.read_text(encoding="utf-8")) if f["id"] == "timeline")
    assert [r["name"] for r in line["rows"]] == ["fault: dropout, sensor.alpha", "fault: dropout, sensor.cas"]


def test_of_close_alarms_the_time_line_names_the_longest_as_the_table_does(flight, page):
    line = next(f for f in figures(page.read_text(encoding="utf-8")) if f["id"] == "timeline")
    labels = {a["y"]: a["text"] for a in line["layout"]["annotations"] if a.get("detector") == "ema_kalman"}
    told = [d for d in flight[1].detectors if d["id"] == "ema_kalman" and d["isolated"]]
    assert told and all(d["false_alarms"] > 1 for d in told)  # a tick's alarm with another name stands first
    for d in told:
        name = d["isolated"]["target"].removeprefix("elevator.").replace("_", " ").replace(".", " | ")
        lane, sensor = name.split(" | ")
        assert labels[f"ema_kalman {lane}"].startswith(f"{d['isolated']['class']} {sensor}")


def test_an_estimate_of_a_side_or_all_elevators_says_that_it_is_a_mean(page):
    told = {f["id"]: f for f in figures(page.read_text(encoding="utf-8"))}
    text = page.read_text("utf-8")
    assert "d-rfafe" in told and text.count("mean of the segments of the left side, not the deflection of one") == 1
    assert "mean of the segments" not in text.partition('id="d-iotsekf"')[2].partition("</figure>")[0]


def test_lanes_are_judged_as_the_run_judged_them(flight):
    log, result = flight
    lanes = {(lane.id, lane.target): lane.entry for lane in LoggedFlight(log).lanes}
    for told in result.detectors:
        entry = lanes[told["id"], told["target"]]
        for key in ("alarm", "detected_at_s", "detection_delay_s", "isolated", "false_alarms"):
            assert entry[key] == told[key], (told["id"], told["target"], key)


def test_truth_from_the_log_gives_the_estimation_error_of_the_run(flight):
    log, result = flight
    lanes = {(lane.id, lane.target): lane.entry for lane in LoggedFlight(log).lanes}
    compared = 0
    for told in result.detectors:
        if told["estimate_rmse"] is not None:
            entry = lanes[told["id"], told["target"]]
            # the run keeps single precision; nothing else may differ
            assert entry["estimate_rmse"] == pytest.approx(told["estimate_rmse"], rel=1e-4)
            assert entry["estimate_bias"] == pytest.approx(told["estimate_bias"], abs=1e-4 * told["estimate_rmse"])
            compared += 1
    assert compared >= 2


def test_summary_says_who_noticed_when_and_what_they_said(flight, page):
    text = re.sub(r"<[^>]+>", "", re.search(r'id="summary">(.*?)</section>', page.read_text("utf-8"), re.S).group(1))
    seen = next(d for d in flight[1].detectors if d["id"] == "iotsekf" and d["concerned"])
    assert "ofc_liquid on elevator.left_inner at valve, from 4 s" in text
    assert f"iotsekf left inner (actuator level) after {seen['detection_delay_s']:.2f} s" in text
    assert f"said last: {seen['isolated']['class']}" in text
    assert re.search(r"ema_kalman right inner: \d+ false alarm", text)


def test_one_detector_has_one_delay_on_its_page_in_sentence_table_and_terminal(flight, page):
    text, seen = page.read_text("utf-8"), [d for d in flight[1].detectors if d["detection_delay_s"] is not None]
    assert seen
    for d in seen:
        late = f"{d['detection_delay_s']:.2f}"
        row = next(r for r in re.findall(r"<tr.*?</tr>", text) if f"<b>{d['id']}</b>" in r and part(d) in r)
        told = re.findall(rf"{d['id']} {part(d)} \(.*? after ([\d.]+) s".replace(" aircraft", ""), text)
        assert f">{late}</td>" in row and told == [late]


def test_units_of_estimates_are_those_of_the_log_and_no_panel_is_empty(page):
    text = page.read_text("utf-8")
    assert "SI unit" not in text
    for figure in figures(text):
        drawn = {t.get("xaxis") for t in figure["data"]}
        panels = {k.replace("axis", "") for k in figure["layout"] if k.startswith("xaxis")}
        assert panels == drawn, figure["id"]


def test_the_table_shows_the_columns_that_matter_and_keeps_the_rest(page):
    heads = re.findall(r"<th([^>]*)>([^<]+)</th>", page.read_text("utf-8"))
    assert [name for _, name in heads][:4] == ["detector", "watches", "first alarm, s", "right name, s"]
    more = [name for about, name in heads if "more" in about]
    assert "|r| before" in more and "first alarm, s" not in more


def test_sensor_fault_on_the_aircraft_has_its_truth_beside_the_estimate(tmp_path):
    log = tmp_path / "alpha.mcap"
    told = load_scenario("alpha-bias", ["duration_s=6", "faults.0.start_s=2", "detectors.enabled=['lpv_smo']"])
    result = simulate(told, log=log)
    lane = LoggedFlight(log).lanes[0]
    name, truth, unit, *_ = lane.truth
    assert (name, unit) == ("f_hat_alpha", "rad")
    assert truth()[-1] == pytest.approx(math.radians(told.faults[0].model_extra["bias_deg"]))
    assert truth()[100] == 0.0
    assert lane.entry["estimate_rmse"] == pytest.approx(result.detectors[0]["estimate_rmse"], rel=1e-4)


def test_fault_free_flight_and_one_without_detectors_have_a_report(tmp_path):
    for name, extra in (
        ("quiet", ["detectors.enabled=['position_monitor']"]),
        ("bare", ["detectors.enabled=[]", "elevator.feedback='measured'"]),
    ):
        log = tmp_path / f"{name}.mcap"
        simulate(load_scenario("cruise", ["duration_s=2", *extra]), log=log)
        text = render(LoggedFlight(log))
        assert "nothing: every alarm below is a false one" in text
        assert figures(text)


def test_log_that_was_cut_is_shown_as_far_as_it_goes(flight, tmp_path):
    whole = flight[0].read_bytes()
    log = tmp_path / "cut.mcap"
    log.write_bytes(whole[: len(whole) // 2])
    flown = LoggedFlight(log)
    assert 1.0 < flown.end < 8.0
    text = render(flown)
    assert "incomplete: the log ends early" in text and "Parts of the log are lost" in text


def test_what_is_no_flight_and_what_cannot_be_written_get_a_clear_error(flight, tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(b"nothing")
    with pytest.raises(LogError, match="not an MCAP file"):
        flight_report(other, tmp_path / "x.html")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"folder is a file|cannot be written"):
        flight_report(flight[0], tmp_path / "file" / "x.html")


def test_text_of_a_scenario_cannot_break_the_page(tmp_path):
    log = tmp_path / "title.mcap"
    text = (
        "duration_s = 1.0\ntitle = '</script><script>alert(1)</script>'\n[flight]\nmass_t = 200.0\ncg_pct "
        "= 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n"
    )
    (tmp_path / "t.toml").write_text(text)
    simulate(load_scenario(tmp_path / "t.toml", ["detectors.enabled=['position_monitor']"]), log=log)
    assert "<script>alert" not in render(LoggedFlight(log))


def test_envelope_keeps_every_peak_and_every_gap():
    y = np.sin(np.linspace(0, 300, 50_001))
    y[12_345], y[20_000], y[30_000:31_000] = 7.0, -9.0, np.nan
    values, every = envelope(y)
    assert len(values) <= POINTS + 2
    assert np.nanmax(values) == 7.0 and np.nanmin(values) == -9.0
    assert abs(int(np.nanargmax(values)) * every - 12_345) <= 2 * every
    assert np.isnan(values).any()
    short = np.arange(10.0)
    assert np.array_equal(envelope(short)[0], short) and envelope(short)[1] == 1.0


def test_peaks_are_the_largest_of_each_interval():
    values, every = peaks(np.array([1.0, 5.0, 2.0, np.nan, np.nan, np.nan, 3.0]), points=3)
    assert every == 3
    assert values[0] == 5.0 and np.isnan(values[1]) and values[2] == 3.0


def test_spans_are_half_open_and_reach_the_end():
    assert spans([0, 1, 1, 0, 1], 10.0, 0.5) == [(10.5, 11.5), (12.0, 12.5)]
    assert spans([0, 0], 0.0, 1.0) == []


def test_gaps_that_a_drawing_cannot_show_are_closed():
    assert joined([(0.0, 1.0), (1.1, 2.0), (2.5, 3.0), (3.01, 4.0)], 0.2) == [(0.0, 2.0), (2.5, 4.0)]
    assert joined([(0.0, 1.0), (1.2, 2.0)], 0.1) == [(0.0, 1.0), (1.2, 2.0)] and joined([], 1.0) == []


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_browser_draws_every_figure_and_cursor_zoom_toggles_and_theme_work(flight, page, tmp_path):
    found = use(page, tmp_path)
    assert found["errors"] == [] and found["requests"] == []
    assert [p["id"] for p in found["plots"]] == [f["id"] for f in figures(page.read_text("utf-8"))]
    assert all(p["svg"] and p["traces"] and p["marks"] and p["width"] > 300 for p in found["plots"])
    assert not found["overflow"]
    assert found["theme"][0] != found["theme"][1] and found["theme"][2] != found["theme"][3]
    toggle = found["toggle"]
    lanes = sum(d["id"] == toggle["id"] for d in flight[1].detectors)
    assert toggle["before"] == toggle["on"] > 0 and toggle["off"] == 0 and toggle["pressed"] == "false"
    assert toggle["rows_before"] - toggle["rows_off"] == lanes and toggle["rows_on"] == toggle["rows_before"]
    cursor = found["cursor"]
    assert float(cursor["text"].split()[2]) == pytest.approx(cursor["expected"], abs=0.1)
    assert cursor["hairs"] > 20 and cursor["spots"] == 2 and "no fault" in cursor["now"]
    assert found["zoom"] == [[1, 2], [1, 2]]
