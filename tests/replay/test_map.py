"""Recordings of other names, units, signs, rates, clocks: diagnosed as our own flight was, or it is said why not."""

import json
import shutil
from html import unescape
from pathlib import Path
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from flight_point import POINT
from log_samples import same_bits
from recordings import ZERO, write_json
from typer.testing import CliRunner

import cosim
from actuators.block import dtype
from actuators.hydraulic.actuator import NOMINAL
from cosim.cli import commands as cli
from cosim.flight.detection.detectors import wires
from cosim.log import open_log
from cosim.replay import replay
from cosim.replay.caveats import caveats
from cosim.replay.log_schema import ReplayError, detectors
from cosim.replay.map import Prepared, diagnose
from cosim.replay.map_file import load_map
from cosim.replay.map_signals import resample, ticks
from cosim.report.diagnosis_page import Watched
from cosim.scenario.aircraft import load_aircraft
from fdi import registry

EXAMPLE = Path(__file__).parents[1] / "data" / "foreign_map.toml"
DEG, LBF_FT = np.pi / 180.0, 1.3558179483314004
LOCAL = {"iotsekf", "rtsekf_flight", "position_monitor", "ofc_monitor"}


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
    for d in detectors(flight):
        for lane, inputs in d["inputs"].items() if d["id"] != "joint" else ():  # which reads the others
            read = {w.field: w for w in wires(registry.record(d["id"]), "" if lane == "aircraft" else lane)}
            for field, topic, column in inputs:
                if not read[field].flag:
                    out[read[field].signal.word] = flight.array(topic)[:, flight.topics[topic].fields.index(column)]
    return out


def renamed(name):
    return "X_" + name.replace(".", "_").upper()


def messages(frame):
    """Return the rows of a table as messages, an empty cell as null."""
    rows = frame.drop(columns="time").to_dict("records")
    return [("/bench", ZERO + k * 5_000_000, {n: None if np.isnan(v) else v for n, v in row.items()})
            for k, row in enumerate(rows)]  # fmt: skip


WRITERS = {
    "csv": lambda frame, path: frame.to_csv(path, index=False), "parquet": lambda frame, path: frame.to_parquet(path),
    "mcap": lambda frame, path: write_json(path, messages(frame)),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRITERS)
def test_a_lossless_export_gives_the_same_bits_as_the_native_replay(flight, signals, tmp_path, kind):
    frame = pd.DataFrame({"time": np.arange(flight.n_ticks) / 200.0, **{renamed(n): y for n, y in signals.items()}})
    WRITERS[kind](frame, tmp_path / f"bench.{kind}")
    held = {n: ", held = true" for n in signals if n.endswith("_command")}
    prefix = "/bench." if kind == "mcap" else ""
    lines = [f'"{n}" = {{ channel = "{prefix}{renamed(n)}"{held.get(n, "")} }}' for n in signals]
    (tmp_path / "map.toml").write_text(POINT + "[signals]\n" + "\n".join(lines))
    told = diagnose(tmp_path / f"bench.{kind}", tmp_path / "map.toml", output=tmp_path / "out.mcap")
    assert not told.not_run and len(told.detectors) == sum(len(d["lanes"]) for d in detectors(flight))
    new = open_log(tmp_path / "out.mcap")
    for d in detectors(flight):
        for lane in d["lanes"]:
            topic = f"/detectors/{d['id']}/{lane}"
            assert same_bits(new.array(f"/replay{topic}"), flight.array(topic)), topic
    assert next(s for s in told.signals if s["name"] == "alpha")["valid_pct"] == pytest.approx(100 * (1 - 60 / 1000))
    assert "alpha: 60 of 1,000 samples lost; 94 % of the ticks have a value" in told.caveats


def bench_frame(signals, rate=200):
    """Return the recording of tests/data/foreign_map.toml: every `200 / rate`-th sample, in its units and signs."""
    s = {n: y[:: 200 // rate] for n, y in signals.items()}
    t = np.arange(len(s["alpha"])) * 1000.0 / rate
    return pd.DataFrame(
        {
            "clock_ms": t,
            "ELEV_CMD_DEG": -s["de_cmd"] / DEG,
            # as sent: it acts until the next row
            "VALVE_PCT": 100 * np.append(s["left_inner.valve_command"][1:], np.nan),
            "ROD_MM": 1e3 * s["left_inner.rod"],
            "SURF_DEG": -s["left_inner.surface"] / DEG,
            "DP_PCT": 100 * s["left_inner.pressure"],
            "HM0_LBFFT": s["left_inner.hm0"] / LBF_FT,
            "HMD_LBFFT": s["left_inner.hmd"] / LBF_FT,
            "TAS_KT": s["tas"] * 3600 / 1852,
            "AOA_DEG": s["alpha"] / DEG,
            "Q_DEGS": s["q"] / DEG,
        }
    )


@pytest.fixture
def bench(signals, tmp_path):
    """Return what diagnoses a changed recording of the bench by its map, of which texts are replaced."""

    def run(frame=None, replaced=(), more="", **how):
        frame = bench_frame(signals) if frame is None else frame
        text = EXAMPLE.read_text() + more
        for old, new in dict(replaced).items():
            assert old in text
            text = text.replace(old, new)
        frame.to_csv(tmp_path / "bench.csv", index=False, float_format="%.17g")
        (tmp_path / "map.toml").write_text(text)
        return diagnose(tmp_path / "bench.csv", tmp_path / "map.toml", **how)

    return run


def verdicts(told):
    return [(d["id"], d["first_alarm_s"] and round(d["first_alarm_s"] - told.start_s, 6), d["isolated"])
            for d in told.detectors]  # fmt: skip


@pytest.mark.parametrize("jitter_ms", [0.0, 0.02, 2.0])
def test_other_units_signs_and_clocks_give_the_verdicts_of_the_flight(flight, bench, signals, jitter_ms, tmp_path):
    """A command is what is sent at its time, or `held`: what acted until then."""
    sent = bench_frame(signals)
    sent["clock_ms"] += 1.7e9 + np.random.default_rng(3).uniform(-jitter_ms, jitter_ms, len(sent))
    acted = sent.assign(VALVE_PCT=100 * signals["left_inner.valve_command"])
    held = {'"VALVE_PCT", unit = "%"': '"VALVE_PCT", unit = "%", held = true'}
    told = bench(acted, held, output=tmp_path / "out.mcap")
    assert {r["id"] for r in told.detectors} == LOCAL | {"joint"}
    assert told.clock.startswith("clock: clock_ms in ms; 1,000 samples")
    native = {d["id"]: d["replayed"] for d in replay(flight.path, detectors=list(LOCAL)).detectors
              if d["target"] == "elevator.left_inner"}  # fmt: skip
    for name, at, named in (row for row in verdicts(told) if row[0] in LOCAL):
        assert at == pytest.approx(native[name]["detected_at_s"]) and named == native[name]["isolated"], name
        again = open_log(tmp_path / "out.mcap").frame(f"/replay/detectors/{name}/left_inner")["r"].to_numpy()
        assert again == pytest.approx(flight.frame(f"/detectors/{name}/left_inner")["r"].to_numpy(), 1e-6, 1e-6)
    assert verdicts(bench(sent)) == verdicts(told)


def test_an_empty_cell_and_a_missing_row_are_one_rule(signals, tmp_path):
    """Ten lost samples silence no detector of the aircraft, and the share that is judged is said."""
    sensors = {n: y for n, y in signals.items() if "." not in n and n != "de_cmd"}
    frame = pd.DataFrame({"t": np.arange(1000) / 200.0, **sensors, "de_cmd": signals["de_cmd"]})
    lines = [f'{n} = {{ channel = "{n}" }}\n' for n in frame if n != "t"]
    (tmp_path / "map.toml").write_text(POINT + "[signals]\n" + "".join(lines))
    rows, told = list(range(50, 1000, 100)), {}
    empty = frame.copy()
    empty.loc[rows, list(sensors)] = np.nan
    for name, table in {"whole": frame, "cells": empty, "rows": frame.drop(index=rows)}.items():
        table.to_csv(tmp_path / f"{name}.csv", index=False)
        told[name] = diagnose(tmp_path / f"{name}.csv", tmp_path / "map.toml", output=tmp_path / f"{name}.mcap")
    shares = {name: {d["id"]: d["valid_pct"] for d in made.detectors} for name, made in told.items()}
    assert len(shares["whole"]) > 2 and shares["cells"] == shares["rows"] == shares["whole"]
    for name in ("cells", "rows"):
        (said,) = [c for c in told[name].caveats if "10 of 1,000 samples lost; 100 % of the ticks" in c]
        assert {"q", "theta"} <= {*said.partition(":")[0].split(", ")}
    a, b = (open_log(tmp_path / f"{n}.mcap").frame("/replay/detectors/kinematic/aircraft") for n in ("cells", "rows"))
    assert same_bits(a.to_numpy(), b.to_numpy())


def test_units_of_a_bench_are_read(bench, signals, tmp_path):
    """Pressure in bar of an own supply, a transducer in volt, a load on the rod: the same inputs."""
    supply = 1.5 * NOMINAL["P_s"]
    units = {
        'left_inner = "hydraulic"': f"left_inner = {{ hydraulic = {{ P_s = {supply} }} }}",
        '"DP_PCT", unit = "%"': '"DP_PCT", unit = "bar"', '"HM0_LBFFT", unit = "lbf ft"': '"HM0_LBFFT", unit = "kN"',
        '"ROD_MM", unit = "mm"': '"ROD_MM", unit = "mm", scale = 12.5, offset = -0.04',
    }  # fmt: skip
    frame = bench_frame(signals)
    frame["DP_PCT"] *= supply / 100 / 1e5
    frame["ROD_MM"] = (frame["ROD_MM"] + 40.0) / 12.5
    frame["HM0_LBFFT"] *= LBF_FT / NOMINAL["arm"] / 1e3
    read = {}
    for name, how in {"plain": (), "bench": (frame, units)}.items():
        bench(*how, output=tmp_path / "out.mcap")
        read[name] = open_log(tmp_path / "out.mcap").frame("/input/iotsekf/left_inner")
    assert len(read["plain"].columns) > 5
    for column, y in read["plain"].items():
        assert read["bench"][column].to_numpy() == pytest.approx(y.to_numpy(), rel=1e-9, abs=1e-12, nan_ok=True)


def test_hinge_load_may_be_none_by_declaration(bench, tmp_path):
    lines = [line for line in EXAMPLE.read_text().splitlines() if line.startswith('"left_inner.hm')]
    none = '"left_inner.hinge_moment" = { constant = 0.0 }'
    bench(replaced={lines[0]: none, lines[1]: ""}, output=tmp_path / "none.mcap")
    read = open_log(tmp_path / "none.mcap").frame("/input/iotsekf/left_inner")
    assert (read[["hm0_model", "hmd_model"]] == 0).all(axis=None)
    with pytest.raises(ReplayError, match=r"stands beside left_inner\.hm0"):
        bench(more=none)


def test_lost_samples_are_nan_a_number_or_a_flag(bench, signals, tmp_path):
    frame = bench_frame(signals)
    frame.loc[100:119, "AOA_DEG"] = np.nan
    plain = bench(frame, output=tmp_path / "a.mcap")
    lost = (frame.index >= 100) & (frame.index < 120)
    marked = frame.assign(AOA_DEG=frame["AOA_DEG"].mask(lost, -9999), OK=~lost)
    for how in ("missing = -9999", 'valid = "OK"'):
        told = bench(marked, {'"AOA_DEG", unit = "deg"': f'"AOA_DEG", unit = "deg", {how}'})
        assert verdicts(told) == verdicts(plain) and told.caveats == plain.caveats
        assert [s["valid_pct"] for s in told.signals if s["name"] == "alpha"] == [92.0]  # 20 here, 60 in flight


def test_half_the_rate_is_interpolated_and_a_slow_command_is_told(flight, bench, signals, tmp_path):
    how = {"detectors": ["position_monitor"], "overrides": {"position_monitor": {"threshold": 0.01}}}
    told = bench(bench_frame(signals, 100), output=tmp_path / "out.mcap", **how)
    lanes = {d["target"]: d["replayed"] for d in replay(flight.path, **how).detectors}
    native, (row,) = lanes["elevator.left_inner"], told.detectors
    assert row["first_alarm_s"] == pytest.approx(native["detected_at_s"], abs=0.05)
    assert row["isolated"] == native["isolated"]
    again = open_log(tmp_path / "out.mcap").frame("/input/position_monitor/left_inner")["surface"].to_numpy()
    true = signals["left_inner.surface"][: len(again)]
    assert again[::2] == pytest.approx(true[::2], rel=1e-12)
    # between two samples: their mean, off by white noise of 0.02 deg times sqrt(1.5)
    assert np.abs(again - true)[1::2].max() < 6 * 1.5**0.5 * 0.02 * DEG
    *_, said = bench(bench_frame(signals, 100), detectors=["iotsekf"]).caveats
    assert said.startswith("left_inner.valve_command comes at 100 Hz and the tick is 200 Hz")


def test_a_gap_of_the_command_makes_no_alarm_and_is_told(bench, signals):
    frame = bench_frame(signals)
    for n, told in ((1, "2 of 1,000 samples lost; 100 % of"), (2, "has gaps: a filter on it does not know what was")):
        frame.loc[300 : 299 + n, "VALVE_PCT"] = np.nan
        made = bench(frame, detectors=["iotsekf"])
        assert made.detectors[0]["alarms"] == 1 and 2.5 < made.detectors[0]["first_alarm_s"] < 3.0
        assert any(told in c for c in made.caveats)


def test_what_is_missing_is_named_per_detector(bench):
    told = bench(detectors=["rfafe_airframe", "rfafe", "position_monitor"])
    lack = {(r["id"], r["target"]): r["missing"] for r in told.not_run}
    assert lack["rfafe_airframe", "aircraft"] == ["theta"] and "left_outer.surface" in lack["rfafe", "aircraft"]
    assert set(lack["position_monitor", "elevator.left_outer"]) == {"left_outer.surface"}
    with pytest.raises(ReplayError, match=r"Missing: rfafe_airframe of aircraft: theta"):
        bench(detectors=["rfafe_airframe"])
    told = bench(more="theta = { absent = true }", detectors=["rfafe_airframe"])  # a sensor that is lost all along
    assert next(d for d in told.detectors if d["id"] == "rfafe_airframe")["valid_pct"] == 0.0


def test_parameters_and_the_start_can_be_changed(bench):
    tight = {"position_monitor": {"threshold": 1e-4, "share": 0.0}}
    told = bench(detectors=["position_monitor"], overrides=tight, start_s=1.0)
    (row,) = told.detectors
    assert told.start_s == pytest.approx(1.0) and row["alarm"] and 1.0 <= row["first_alarm_s"] < 2.0
    with pytest.raises(ReplayError, match="inf is no time"):
        bench(start_s=float("inf"))
    with pytest.raises(ReplayError, match=r"have 0 ticks of 200 Hz in common; allowed: 2 to"):
        bench(start_s=9.0)
    with pytest.raises(ReplayError, match="would change nothing"):
        bench(detectors=["iotsekf"], overrides={"rfafe": {"x": 1.0}})


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('alfa = { channel = "AOA_DEG" }', ("signals.alfa", "Did you mean 'alpha'")),
        ('alpha = { channel = "AOA" }', ("bench.csv: has no column 'AOA'", "AOA_DEG")),
        ('alpha = { channel = "AOA_DEG", unit = "kt" }', ("signals.alpha.unit: 'kt' is no unit", "units of rad")),
        (
            'alpha = { channel = "AOA_DEG", unit = "V" }',
            ("signals.alpha.unit", "Of a transducer: unit of the quantity"),
        ),
        ('alpha = { channel = "AOA_DEG", held = true }', ("signals.alpha.held", "only a command to an actuator")),
        ('alpha = { channel = "AOA_DEG", units = "deg" }', ("unknown key", "signals.alpha.units")),
        ('alpha = { channel = "AOA_DEG", scale = "x" }', ('signals.alpha.scale = "x"', "must be a valid number")),
        ('"aft.rod" = { channel = "AOA_DEG" }', ("no elevator segment 'aft'; its own are left_outer",)),
        ("alpha = 3", ("signals.alpha = 3", "must be a table")),
        ('alpha = { unit = "deg" }', ("channel or a constant",)),
        ("alpha = { constant = 0.1 }", ("no signal has a channel",)),
    ],
)
def test_mistakes_in_a_map_are_one_line_and_exit_with_2(signals, tmp_path, line, words):
    bench_frame(signals).iloc[:50].to_csv(tmp_path / "bench.csv", index=False)
    (tmp_path / "map.toml").write_text('time = "clock_ms"\n' + POINT + "[signals]\n" + line)
    done = CliRunner().invoke(cli.app, ["replay", str(tmp_path / "bench.csv"), "--map", str(tmp_path / "map.toml")])
    assert done.exit_code == 2 and done.stderr.count("\n") == 1 and not done.stdout
    assert all(w in done.stderr for w in words) and str(tmp_path) in done.stderr


def test_a_map_without_signals_and_a_table_without_a_map_are_refused(tmp_path):
    (tmp_path / "map.toml").write_text('time = "clock_ms"\n')
    with pytest.raises(ReplayError, match=r"map.toml: signals: is missing$"):
        load_map(tmp_path / "map.toml")
    with pytest.raises(ReplayError, match=r"is a table, no log.*--map"):
        replay(tmp_path / "bench.csv")


def test_a_heading_passes_north_between_two_samples(tmp_path):
    t = np.arange(0.0, 4.0, 0.04)
    pd.DataFrame({"t": t, "HDG": (355.0 + 5.0 * t) % 360.0}).to_csv(tmp_path / "turn.csv", index=False)
    (tmp_path / "map.toml").write_text(f'{POINT}[signals]\npsi = {{ channel = "HDG", unit = "deg" }}\n')
    psi, there = Prepared(tmp_path / "turn.csv", tmp_path / "map.toml", None, 0.0, ()).values["psi"]
    flown = DEG * (355.0 + 5.0 * 0.005 * np.arange(len(psi)))
    np.testing.assert_allclose(np.exp(1j * psi[there > 0]), np.exp(1j * flown[there > 0]), atol=1e-9)


def test_the_nearest_sample_is_the_ticks_and_others_are_interpolated_or_held():
    t, y = np.array([0.002, 0.01, 0.0501, 0.06]), np.array([1.0, 3.0, 7.0, 9.0])
    grid = np.arange(13) * 0.005
    at = ticks([grid, np.array([-1.0, 0.1])], 0.005)
    assert at.tolist() == grid.tolist() and ticks([grid], 0.005, 0.05)[0] == pytest.approx(0.05)
    assert ticks([grid + 0.002 * (grid == 0.0)], 0.005)[0] == pytest.approx(0.0, abs=1e-4)  # its first sample came late
    line, good = resample(t, y, at, 0.005, linear=True, max_gap=0.02)
    assert line[[0, 2, 10, 12]].tolist() == [1.0, 3.0, 7.0, 9.0] and line[1] == pytest.approx(1.75)
    assert good.tolist() == [1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1]
    held, good = resample(t, y, at, 0.005, linear=False, max_gap=0.008)
    assert held[[0, 1, 2, 3, 10, 11, 12]].tolist() == [1, 1, 3, 3, 7, 7, 9]
    assert good.tolist() == [1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize("aircraft", ["narrowbody", "mine/narrowbody"])
def test_segments_of_another_aircraft_are_mapped_by_their_own_names(aircraft, tmp_path):
    shutil.copytree(load_aircraft("narrowbody").folder, tmp_path / "mine" / "narrowbody")
    t = np.arange(400) / 200.0
    pd.DataFrame({"t": t, "cmd": np.sin(t), "surf": np.sin(t - 0.08)}).to_csv(tmp_path / "a.csv", index=False)
    point = "mass_t = 60.0\ncg_pct = 25.0\naltitude_ft = 20000.0\ncas_kt = 270.0\n"
    signals = (
        '[signals]\nde_cmd = { channel = "cmd", unit = "deg" }\n"right.surface" = { channel = "surf", unit = "deg" }'
    )
    (tmp_path / "map.toml").write_text(f'[flight]\naircraft = "{aircraft}"\n{point}{signals}')
    told = diagnose(tmp_path / "a.csv", tmp_path / "map.toml", detectors=["position_monitor"])
    assert [d["target"] for d in told.detectors] == ["elevator.right"]


def test_the_page_of_a_diagnosis_shows_verdicts_and_what_was_read(bench, signals, tmp_path):
    told = bench(bench_frame(signals).drop(range(300, 400)), output=tmp_path / "out.mcap")
    made = CliRunner().invoke(cli.app, ["report", str(tmp_path / "out.mcap"), "--json"])
    assert made.exit_code == 0, made.stderr
    page = Path(json.loads(made.stdout)["report"]).read_text()
    assert "diagnosis of bench.csv" in page and "What they read" in page and "left_inner.rod" in page
    assert all(f'data-detector="{d["id"]}"' in page for d in told.detectors)
    assert "false alarm" not in page[: page.index("<script")] and f"{told.not_run[0]['id']} of " in page
    watched = Watched(tmp_path / "out.mcap")
    assert watched.caveats == [told.clock, *told.caveats] and all(text in unescape(page) for text in told.caveats)
    assert watched.inputs()["left_inner.rod"][0] == "m" and len(watched.lanes) == len(told.detectors)
    held = CliRunner().invoke(cli.app, ["info", str(tmp_path / "out.mcap")])
    assert held.exit_code == 0 and f"{told.not_run[0]['id']} of " in held.stdout, held.output


class Stub:
    """A detector that ran: outputs r, alarm, valid, why."""

    id = "rfafe_airframe"
    record = SimpleNamespace(level="aircraft", every=1, any_aircraft=False, range=MappingProxyType({}))
    module = SimpleNamespace(STATE=dtype([(n, "f8") for n in ("r", "alarm", "valid", "why")]),
                             OUTPUTS=("r", "alarm", "valid", "why"))  # fmt: skip

    def target(self, lane):
        return "aircraft"


def said(rows, aircraft="", t_0=0.0):
    """Return what is said of outputs (n, 4) at ticks of 5 ms."""
    scenario = SimpleNamespace(aircraft=load_aircraft())
    made = SimpleNamespace(map=SimpleNamespace(aircraft=aircraft or scenario.aircraft.name), scenario=scenario)
    made.dt, made.at = 0.005, np.array([t_0])
    return " ".join(caveats(made, [(Stub(), "aircraft", None, rows)]))


@pytest.mark.parametrize(
    ("alarms_s", "ready_s", "words"),
    [
        ([(0.03, 30.0)], 0.0, "alarms for 100 % of its valid time"),
        ([(11.0, 30.0)], 6.0, "alarms for 79 % of its valid time, from 11 s (valid from 6 s)"),
        ([(13.0, 30.0)], 6.0, ""),  # a fault after a quiet start as long as the detector needs
        ([(0.0, 6.0)], 0.0, ""),
        ([(0.0, 0.5), (12.0, 30.0)], 0.0, ""),  # a false alarm at the start
    ],
)
def test_an_alarm_from_the_start_is_told_as_a_model_that_does_not_fit(alarms_s, ready_s, words):
    rows, ready = np.zeros((6000, 4)), round(200 * ready_s)
    rows[ready:, 2], rows[:ready, 3] = 1.0, 1.0
    for a, b in alarms_s:
        rows[round(200 * a) : round(200 * b), 1] = 1.0
    assert words in said(rows) and (words or not said(rows))


def test_other_aircraft_and_numbers_that_are_not_finite_are_told():
    rows = np.zeros((1000, 4))
    rows[:, 2] = np.arange(1000) < 400
    assert said(rows, "Citation II").startswith("rfafe_airframe: designed for another aircraft, transport, than the")
    rows[400:, 3], rows[400, 0] = 11.0, np.inf
    told = "rfafe_airframe of aircraft: its numbers are not finite for"
    assert said(rows, t_0=10.0) == f"{told} 3 s, first at 12 s"
    rows[400:, 2:] = 1.0, 0.0  # one tick, and it stays valid
    assert said(rows, t_0=10.0) == f"{told} 0.005 s, first at 12 s"
