"""Foreign data (CSV, Parquet, MCAP) of other names, units, signs and rates is diagnosed as our own flight was."""

import json
from html import unescape
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT
from log_samples import same_bits
from mcap.writer import Writer
from typer.testing import CliRunner

import cosim
from actuators.hydraulic.actuator import NOMINAL
from cosim.cli import commands as cli
from cosim.flight.build import build
from cosim.flight.detection.detector_context import site
from cosim.flight.detection.detectors import wires
from cosim.flight.fly import record
from cosim.log import open_log
from cosim.replay import replay
from cosim.replay.detector_replay import manifest, output_names, replay_lane, unlogged
from cosim.replay.lane_inputs import delays, in_time, lane_inputs
from cosim.replay.log_schema import ReplayError
from cosim.replay.map import diagnose, prepare
from cosim.replay.map_file import load_map
from cosim.replay.map_signals import resample, ticks
from cosim.report.diagnosis_page import Watched
from fdi import registry
from fdi.hydraulic import iotsekf
from fdi.hydraulic.iotsekf import DETECTOR

EXAMPLE = Path(__file__).parents[1] / "data" / "foreign_map.toml"


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Return the log of a flight with every detector, a fault on the valve and a sensor that drops out."""
    path = tmp_path_factory.mktemp("map") / "flight.mcap"
    drop = '{target="sensor.alpha", kind="dropout", start_s=2.0, end_s=2.3}'
    scenario = cosim.load_scenario("liquid-ofc", ["duration_s=5", "faults.0.start_s=2.5", f"faults.1={drop}"])
    cosim.simulate(scenario, log=path, timed=False)
    return open_log(path)


@pytest.fixture(scope="module")
def signals(flight):
    """Return {signal: (samples, SI)} of all that the detectors of the flight read, by the names of a map."""
    out = {}
    for d in manifest(flight):
        for lane, inputs in d["inputs"].items():
            read = {w.field: w for w in wires(registry.record(d["id"]), "" if lane == "aircraft" else lane)}
            for field, topic, column in inputs:
                if not read[field].flag:
                    out[read[field].signal.word] = flight.array(topic)[:, flight.topics[topic].fields.index(column)]
    return out


def exact_map(path, names, prefix=""):
    """Write a map whose channels are SI, at the same rate, under other names."""
    held = {n: ", held = true" for n in names if n.endswith("_command")}
    lines = [f'"{n}" = {{ channel = "{prefix}{renamed(n)}"{held.get(n, "")} }}' for n in names]
    path.write_text(POINT + "[signals]\n" + "\n".join(lines))
    return path


def renamed(name):
    return "X_" + name.replace(".", "_").upper()


def _csv(frame, path):
    frame.to_csv(path, index=False)


def _mcap(frame, path):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/bench", "json", writer.register_schema("x", "jsonschema", b'{"type": "object"}')
        )
        rows = frame.drop(columns="time").to_dict("records")
        for k, row in enumerate(rows):
            kept = {n: None if np.isnan(v) else v for n, v in row.items()}
            writer.add_message(channel, 10**18 + k * 5_000_000, json.dumps(kept).encode(), 10**18 + k * 5_000_000)
        writer.finish()


WRITERS = {"csv": _csv, "parquet": lambda frame, path: frame.to_parquet(path), "mcap": _mcap}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_lossless_export_gives_the_same_bits_as_the_native_replay(flight, signals, tmp_path, kind):
    frame = pd.DataFrame({"time": np.arange(flight.n_ticks) / 200.0, **{renamed(n): y for n, y in signals.items()}})
    recording = tmp_path / f"bench.{kind}"
    WRITERS[kind](frame, recording)
    map_ = exact_map(tmp_path / "map.toml", signals, "/bench." if kind == "mcap" else "")
    told = diagnose(recording, map_, output=tmp_path / "out.mcap")
    assert not told.not_run and len(told.detectors) == sum(len(d["lanes"]) for d in manifest(flight))
    new = open_log(tmp_path / "out.mcap")
    for d in manifest(flight):
        for lane in d["lanes"]:
            topic = f"/detectors/{d['id']}/{lane}"
            assert same_bits(new.array(f"/replay{topic}"), flight.array(topic)), topic
    assert next(s for s in told.signals if s["name"] == "alpha")["valid_pct"] == pytest.approx(100 * (1 - 60 / 1000))


def bench_frame(signals, rate):
    """Return the recording of tests/data/foreign_map.toml: every `200 / rate`-th sample, in its units and signs."""
    s = {n: y[:: 200 // rate] for n, y in signals.items()}
    deg, lbfft = 180.0 / np.pi, 1.0 / 1.3558179483314004
    t = np.arange(len(s["alpha"])) * 1000.0 / rate
    return pd.DataFrame(
        {
            "clock_ms": t,
            "ELEV_CMD_DEG": -deg * s["de_cmd"],
            # as sent: it acts until the next row
            "VALVE_PCT": 100 * np.append(s["left_inner.valve_command"][1:], np.nan),
            "ROD_MM": 1e3 * s["left_inner.rod"],
            "SURF_DEG": -deg * s["left_inner.surface"],
            "DP_PCT": 100 * s["left_inner.pressure"],
            "HM0_LBFFT": lbfft * s["left_inner.hm0"],
            "HMD_LBFFT": lbfft * s["left_inner.hmd"],
            "TAS_KT": s["tas"] * 3600 / 1852,
            "AOA_DEG": deg * s["alpha"],
            "Q_DEGS": deg * s["q"],
        }
    )


def test_other_units_and_signs_agree_to_rounding(flight, signals, tmp_path):
    frame = bench_frame(signals, 200)
    frame["VALVE_PCT"] = 100 * signals["left_inner.valve_command"]
    frame.to_csv(tmp_path / "bench.csv", index=False)
    text = EXAMPLE.read_text().replace('"VALVE_PCT", unit = "%"', '"VALVE_PCT", unit = "%", held = true')
    (tmp_path / "map.toml").write_text(text)
    told = diagnose(tmp_path / "bench.csv", tmp_path / "map.toml", output=tmp_path / "out.mcap")
    new = open_log(tmp_path / "out.mcap")
    names = {"iotsekf", "rtsekf", "rtsekf_flight", "position_monitor", "ofc_monitor"}
    for name in names:
        again = new.frame(f"/replay/detectors/{name}/left_inner")
        logged = flight.frame(f"/detectors/{name}/left_inner")
        assert (again["alarm"] == logged["alarm"]).all()
        np.testing.assert_allclose(again["r"], logged["r"], rtol=1e-6, atol=1e-6)
    assert {r["id"] for r in told.detectors} == names


def test_units_of_a_bench_are_read(flight, signals, tmp_path):
    """Pressure in bar of an own supply, a transducer in volt, a current in mA, a load on the rod: the same verdicts."""
    supply = 1.5 * NOMINAL["P_s"]
    own = f"left_inner = {{ hydraulic = {{ P_s = {supply} }} }}"
    text = EXAMPLE.read_text().replace('left_inner = "hydraulic"', own)
    bench = text.replace('"DP_PCT", unit = "%"', '"DP_PCT", unit = "bar"')
    bench = bench.replace('"ROD_MM", unit = "mm"', '"ROD_MM", unit = "mm/V", scale = 12.5, offset = -0.04')
    bench = bench.replace('"HM0_LBFFT", unit = "lbf ft"', '"HM0_LBFFT", unit = "kN"')
    frame = bench_frame(signals, 200)
    told = {}
    for name, map_ in (("plain", text), ("bench", bench)):
        if name == "bench":
            frame["DP_PCT"] *= supply / 100 / 1e5
            frame["ROD_MM"] = (frame["ROD_MM"] + 40.0) / 12.5
            frame["HM0_LBFFT"] *= 1.3558179483314004 / NOMINAL["arm"] / 1e3
        frame.to_csv(tmp_path / "bench.csv", index=False)
        (tmp_path / "map.toml").write_text(map_)
        diagnose(tmp_path / "bench.csv", tmp_path / "map.toml", output=tmp_path / "out.mcap")
        told[name] = open_log(tmp_path / "out.mcap").frame("/input/iotsekf/left_inner")
    assert len(told["plain"].columns) > 5
    for column in told["plain"]:
        plain = told["plain"][column].to_numpy()
        assert told["bench"][column].to_numpy() == pytest.approx(plain, rel=1e-9, abs=1e-12, nan_ok=True)


def test_hinge_load_may_be_none_by_declaration_or_measured(signals, tmp_path):
    bench_frame(signals, 200).to_csv(tmp_path / "bench.csv", index=False)
    lines = EXAMPLE.read_text().splitlines()
    rest = [line for line in lines if not line.startswith('"left_inner.hm')]
    (tmp_path / "map.toml").write_text("\n".join([*rest, '"left_inner.hinge_moment" = { constant = 0.0 }']))
    diagnose(tmp_path / "bench.csv", tmp_path / "map.toml", output=tmp_path / "none.mcap")
    read = open_log(tmp_path / "none.mcap").frame("/input/iotsekf/left_inner")
    assert (read[["hm0_model", "hmd_model"]] == 0).all(axis=None)
    (tmp_path / "map.toml").write_text("\n".join([*lines, '"left_inner.hinge_moment" = { constant = 0.0 }']))
    with pytest.raises(ReplayError, match=r"stands beside left_inner\.hm0"):
        diagnose(tmp_path / "bench.csv", tmp_path / "map.toml")


def test_a_volt_without_a_scale_is_refused_with_the_way_to_say_it(signals, tmp_path):
    bench_frame(signals, 200).to_csv(tmp_path / "bench.csv", index=False)
    (tmp_path / "map.toml").write_text(EXAMPLE.read_text().replace('"ROD_MM", unit = "mm"', '"ROD_MM", unit = "V"'))
    with pytest.raises(ReplayError, match=r"'V' is no unit of it.*unit = 'm/V' with scale"):
        diagnose(tmp_path / "bench.csv", tmp_path / "map.toml")


def test_a_command_counts_from_when_it_is_sent(flight, signals, tmp_path):
    """What a servo sends at a tick acts until the next; a map that says otherwise is a tick off, which the pressure
    tells."""
    names = ("rod", "surface", "pressure", "hm0", "hmd")
    sent = flight.frame("/actuators/hydraulic/left_inner/servo")["u"].to_numpy()
    read = {n: signals[f"left_inner.{n}"] for n in names}
    frame = pd.DataFrame({"time": np.arange(flight.n_ticks) / 200.0, "valve_command": sent, **read})
    frame.to_csv(tmp_path / "own.csv", index=False)
    lines = [f'"left_inner.{n}" = {{ channel = "{n}" }}' for n in ("valve_command", *names)]
    (tmp_path / "map.toml").write_text(POINT + "[signals]\n" + "\n".join(lines))
    how = {"detectors": ["iotsekf"], "output": tmp_path / "out.mcap"}
    told = diagnose(tmp_path / "own.csv", tmp_path / "map.toml", **how)
    alarm = flight.frame("/detectors/iotsekf/left_inner")["alarm"].to_numpy()
    assert told.detectors[0]["first_alarm_s"] == pytest.approx(np.argmax(alarm > 0.5) / 200.0, abs=1e-9)
    where = "/replay/detectors/iotsekf/left_inner"
    again = open_log(tmp_path / "out.mcap").frame(where)
    np.testing.assert_array_equal(again["alarm"], alarm)
    assert not any("valve_command" in c for c in told.caveats)
    lines[0] = lines[0].replace(" }", ", held = true }")
    (tmp_path / "map.toml").write_text(POINT + "[signals]\n" + "\n".join(lines))
    told = diagnose(tmp_path / "own.csv", tmp_path / "map.toml", **how)
    assert any("valve_command is recorded 5 ms too early" in c for c in told.caveats)
    early = open_log(tmp_path / "out.mcap").frame(where)
    np.testing.assert_allclose(early["f_hat"][200:], again["f_hat"][200:], atol=1e-6)


@pytest.mark.parametrize("rate", [50, 100, 200, 1000])
def test_a_command_some_ticks_off_is_moved_and_is_no_alarm(rate, tmp_path):
    """Recorded elsewhere, a command may be one or two ticks early or late, at any rate."""
    calm = ["duration_s=4", f"rate_hz={rate}", 'flight.turbulence="light"']
    setup, own, n = build(cosim.load_scenario("cruise", calm)), wires(DETECTOR, "left_inner"), 4 * rate
    rows, *_ = record(setup, [f"iotsekf_in.left_inner.{w.field}" for w in own if not w.flag])
    exact = {w.signal.word: (y, np.ones(n)) for w, y in zip((w for w in own if not w.flag), rows.T)}
    p = DETECTOR.fit(site(1.0 / rate, "left_inner", setup.scenario.elevator.technology))
    for late in (-2, -1, 0, 1, 2):
        y = exact["left_inner.valve_command"][0][np.clip(np.arange(n) + late, 0, n - 1)]
        values = {**exact, "left_inner.valve_command": (y, np.ones(n))}
        found = delays(setup.scenario, values, n, 1.0 / rate)
        assert found == ({"left_inner.valve_command": late} if late else {})
        u = lane_inputs(iotsekf, own, in_time(values, found), n)
        lane = unlogged(DETECTOR, "left_inner", iotsekf, u, p)
        again = replay_lane(lane, 1.0 / rate)[0]
        assert not again[:, output_names(lane).index("alarm")].any()


def test_a_fault_from_the_start_is_no_delay_of_the_command():
    """A solid oscillation is a phase of the pressure to the command, as a delay is."""
    early = ["duration_s=5", "faults.0.start_s=0.0", "faults.0.frequency_hz=8"]
    setup, own = build(cosim.load_scenario("solid-ofc", early)), wires(DETECTOR, "left_inner")
    rows, *_ = record(setup, [f"iotsekf_in.left_inner.{w.field}" for w in own if not w.flag])
    values = {w.signal.word: (y, np.ones(len(y))) for w, y in zip((w for w in own if not w.flag), rows.T)}
    assert delays(setup.scenario, values, len(rows), 0.005) == {}


def test_a_second_of_settled_recording_is_too_short_to_tell_a_delay(signals):
    early = {n: (np.append(y[1:], y[-1]) if n.endswith("valve_command") else y) for n, y in signals.items()}
    scenario, told = cosim.load_scenario("liquid-ofc"), {}
    for n in (206, 390, 450):
        values = {name: (y[:n], np.isfinite(y[:n]).astype(float)) for name, y in early.items()}
        told[n] = delays(scenario, values, n, 0.005).get("left_inner.valve_command", 0.0)
    assert told == {206: 0.0, 390: 0.0, 450: 1.0}


def test_half_the_rate_is_interpolated_and_slow_detectors_agree(flight, signals, tmp_path):
    bench_frame(signals, 100).to_parquet(tmp_path / "bench.parquet")
    how = {"detectors": ["position_monitor"], "overrides": {"position_monitor": {"threshold": 0.01}}}
    (row,) = diagnose(tmp_path / "bench.parquet", EXAMPLE, output=tmp_path / "out.mcap", **how).detectors
    lanes = {d["target"]: d["replayed"] for d in replay(flight.path, **how).detectors}
    native = lanes["elevator.left_inner"]
    assert native["alarm"] and row["first_alarm_s"] == pytest.approx(native["detected_at_s"], abs=0.05)
    assert row["isolated"] == native["isolated"]
    again = open_log(tmp_path / "out.mcap").frame("/input/position_monitor/left_inner")
    true = signals["left_inner.surface"][: len(again)]
    assert again["surface"].to_numpy()[::2] == pytest.approx(true[::2], rel=1e-12)
    # between two samples: their mean, off by white noise of 0.02 deg times sqrt(1.5)
    between = np.abs(again["surface"].to_numpy() - true)[1::2]
    assert between.max() < 6 * 1.5**0.5 * np.radians(0.02)


def test_what_is_missing_is_named_per_detector(signals, tmp_path):
    bench_frame(signals, 200).to_csv(tmp_path / "bench.csv", index=False)
    told = diagnose(tmp_path / "bench.csv", EXAMPLE)
    lack = {(r["id"], r["target"]): r["missing"] for r in told.not_run}
    assert lack["rfafe_airframe", "aircraft"] == ["theta"]
    assert "left_outer.surface" in lack["rfafe", "aircraft"]
    assert set(lack["position_monitor", "elevator.left_outer"]) == {"left_outer.surface"}
    with pytest.raises(ReplayError, match=r"Missing: rfafe_airframe of aircraft: theta"):
        diagnose(tmp_path / "bench.csv", EXAMPLE, detectors=["rfafe_airframe"])


def test_parameters_and_the_start_can_be_changed(signals, tmp_path):
    bench_frame(signals, 200).to_csv(tmp_path / "bench.csv", index=False)
    tight = {"position_monitor": {"threshold": 1e-4, "share": 0.0}}
    told = diagnose(tmp_path / "bench.csv", EXAMPLE, detectors=["position_monitor"], overrides=tight, start_s=1.0)
    (row,) = told.detectors
    assert told.start_s == pytest.approx(1.0) and row["alarm"] and 1.0 <= row["first_alarm_s"] < 2.0


def test_a_recording_that_does_not_fit_is_refused_and_a_late_command_is_told(signals, tmp_path):
    frame = bench_frame(signals, 200)
    frame.assign(clock_ms=1e9 * frame.clock_ms).to_csv(tmp_path / "long.csv", index=False)
    with pytest.raises(ReplayError, match="Is time in seconds"):
        diagnose(tmp_path / "long.csv", EXAMPLE)
    with pytest.raises(ReplayError, match="inf is no time"):
        diagnose(tmp_path / "long.csv", EXAMPLE, start_s=float("inf"))
    with pytest.raises(ReplayError, match="--map"):
        replay(tmp_path / "long.csv")
    frame.assign(VALVE_PCT="n/a?").to_csv(tmp_path / "text.csv", index=False)
    with pytest.raises(ReplayError, match="'VALVE_PCT' holds something that is no number"):
        diagnose(tmp_path / "text.csv", EXAMPLE)
    with pytest.raises(ReplayError, match="would change nothing"):
        diagnose(tmp_path / "text.csv", EXAMPLE, detectors=["iotsekf"], overrides={"rfafe": {"x": 1.0}})
    for rate, told in ((200, 0), (100, 1)):
        bench_frame(signals, rate).to_csv(tmp_path / "bench.csv", index=False)
        caveats = diagnose(tmp_path / "bench.csv", EXAMPLE, detectors=["iotsekf"]).caveats
        assert len(caveats) == told and all("left_inner.valve_command comes at 100 Hz" in c for c in caveats)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('alfa = { channel = "AOA_DEG" }', ("signals.alfa", "Did you mean 'alpha'")),
        ('alpha = { channel = "AOA" }', ("no channel 'AOA'", "AOA_DEG")),
        ('alpha = { channel = "AOA_DEG", unit = "kt" }', ("signals.alpha.unit", "rad, deg")),
        ('alpha = { channel = "AOA_DEG", units = "deg" }', ("unknown key", "signals.alpha.units")),
        ('alpha = { channel = "AOA_DEG", scale = "x" }', ('signals.alpha.scale = "x"', "must be a valid number")),
        ("alpha = 3", ("signals.alpha = 3", "must be a table")),
        ('alpha = { unit = "deg" }', ("channel or a constant",)),
        ("alpha = { constant = 0.1 }", ("no signal has a channel",)),
    ],
)
def test_mistakes_in_a_map_are_named(signals, tmp_path, line, words):
    bench_frame(signals, 200).iloc[:50].to_csv(tmp_path / "bench.csv", index=False)
    (tmp_path / "map.toml").write_text('time = "clock_ms"\n' + POINT + "[signals]\n" + line)
    with pytest.raises(ReplayError) as error:
        diagnose(tmp_path / "bench.csv", tmp_path / "map.toml")
    assert all(w in str(error.value) for w in words) and "map.toml" in str(error.value)


def test_a_map_without_signals_says_so(tmp_path):
    (tmp_path / "map.toml").write_text('time = "clock_ms"\n')
    with pytest.raises(ReplayError, match=r"map.toml: signals: is missing$"):
        load_map(tmp_path / "map.toml")


def test_a_heading_passes_north_between_two_samples(tmp_path):
    t = np.arange(0.0, 4.0, 0.04)
    frame = pd.DataFrame({"t_s": t, "HDG": (355.0 + 5.0 * t) % 360.0, "cmd": 0.0, "surf": 0.0})
    frame.to_csv(tmp_path / "turn.csv", index=False)
    signals = """[signals]
psi = { channel = "HDG", unit = "deg" }
r = { derivative_of = "psi" }
de_cmd = { channel = "cmd", unit = "deg" }
"left_inner.surface" = { channel = "surf", unit = "deg" }
"""
    (tmp_path / "map.toml").write_text(f"{POINT}{signals}")
    values = prepare(tmp_path / "turn.csv", tmp_path / "map.toml").values
    psi, there = values["psi"]
    flown = np.radians(355.0 + 5.0 * 0.005 * np.arange(len(psi)))
    np.testing.assert_allclose(np.exp(1j * psi[there > 0]), np.exp(1j * flown[there > 0]), atol=1e-9)
    np.testing.assert_allclose(values["r"][0][values["r"][1] > 0], np.radians(5.0), atol=1e-9)


def test_samples_on_a_tick_are_kept_and_others_interpolated_or_held():
    t, y = np.array([0.0, 0.01, 0.02, 0.05, 0.06]), np.array([1.0, 3.0, np.nan, 7.0, 9.0])
    line, good = resample(t, y, 0.0, 0.005, 13, linear=True, max_gap=0.02)
    assert line[:3].tolist() == [1.0, 2.0, 3.0] and good.tolist() == [1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1]
    held, good = resample(t, y, 0.0, 0.005, 13, linear=False, max_gap=0.008)
    assert held[[0, 1, 2, 3, 10, 11, 12]].tolist() == [1, 1, 3, 3, 7, 7, 9]
    assert good.tolist() == [1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1, 1, 1]
    assert ticks([(0.0, 1.0), (0.1, 0.9)], 0.005) == (0.1, 161)
    start, n = ticks([(0.0, 1.0)], 0.005, 0.5)
    assert (start, n) == (pytest.approx(0.5), 101)


def test_the_page_of_a_diagnosis_shows_verdicts_and_what_was_read(signals, tmp_path):
    bench_frame(signals, 200).drop(range(300, 400)).to_csv(tmp_path / "bench.csv", index=False)
    out = tmp_path / "out.mcap"
    told = diagnose(tmp_path / "bench.csv", EXAMPLE, output=out)
    made = CliRunner().invoke(cli.app, ["report", str(out), "--json"])
    assert made.exit_code == 0, made.stderr
    page = Path(json.loads(made.stdout)["report"]).read_text()
    assert "diagnosis of bench.csv" in page and "What they read" in page and "left_inner.rod" in page
    assert all(f'data-detector="{d["id"]}"' in page for d in told.detectors)
    assert "false alarm" not in page[: page.index("<script")]
    assert told.not_run and f"{told.not_run[0]['id']} of " in page
    watched = Watched(out)
    assert watched.caveats == told.caveats != [] and all(text in unescape(page) for text in told.caveats)
    assert watched.inputs()["left_inner.rod"][0] == "m" and len(watched.lanes) == len(told.detectors)
