"""Every door under fire: mutated and forged logs, scenarios, maps, campaign files, recordings. One line or a result, in
bounded time; never a traceback. COSIM_CASES cases of each kind, printed (`pytest -m slow -s tests/test_doors.py`).
"""

import json
import os
import random
import time
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from forged import forge
from log_samples import reseal

import cosim
from cosim.campaign.spec import load_campaign
from cosim.errors import CosimError
from cosim.log import open_log, recover
from cosim.log.info import log_info
from cosim.replay import replay
from cosim.replay.map import diagnose
from cosim.replay.map_file import load_map
from cosim.report import flight_report

CASES = int(os.environ.get("COSIM_CASES", "1000"))
SLOWEST_S = 20.0
WORDS = ["0", "-1", "1e308", "-1e308", "nan", "inf", "true", "[]", "{}", "[[]]", "''", '"x"', "2020-01-01", "10:00:00",
         "[{}]", "9" * 400, "1e-320", "0x7fffffffffffffff", "1_0", '"\\u0000"', '"elevator.left"', "1.5", "[1, 'a']",
         "{a = 1}", "99999999999999999999", '"' + "x" * 3000 + '"', "=", "", "#", '"../../etc/passwd"']  # fmt: skip


KEYS = ("duration_s", "seed", "rate_hz", "flight.mass_t", "flight.mach", "manoeuvre.kind", "faults.0", "faults.0.kind",
        "elevator.feedback", "sensors.alpha.bias_deg", "detectors.enabled", "title", "tolerances.aero.Cm_q",
        "faults.99.kind", "x.y.z", "faults.0.target")  # fmt: skip
STRANGE = (None, -1, 1e308, "x", [], {}, [[]], 10**30, True, "é" * 500)
NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e18, 1e18, -1.0, 0.5)


def tried(kind, n, make, doors):
    """Send `n` cases of `make(rng)` through every door; print what came of them."""
    rng = random.Random(f"{kind} {CASES}")
    taken = refused = 0
    slowest = 0.0
    for _ in range(n):
        case = make(rng)
        for door in doors:
            begun = time.monotonic()
            try:
                door(case)
                taken += 1
            except CosimError as error:
                refused += 1
                assert "\n" not in str(error)
            slowest = max(slowest, time.monotonic() - begun)
            assert slowest < SLOWEST_S
    print(f"\n{kind}: {n} cases, {taken} taken, {refused} refused, slowest {slowest:.2f} s")


def mangled(rng, text):
    """Return TOML text with a few of its values, keys or lines changed."""
    lines = text.splitlines()
    for _ in range(rng.randint(1, 3)):
        k = rng.randrange(len(lines))
        what = rng.random()
        if what < 0.6 and "=" in lines[k]:
            lines[k] = f"{lines[k].split('=')[0]}= {rng.choice(WORDS)}"
        elif what < 0.7:
            lines.insert(k, rng.choice(lines))
        elif what < 0.8:
            lines[k] = lines[k].replace(rng.choice("aeiou.[="), rng.choice("xyz.[]{}=\"'"), 1)
        elif what < 0.9:
            del lines[k]
            lines = lines or ["x"]
        else:
            at = rng.randrange(len(lines[k]) + 1)
            lines[k] = lines[k][:at] + rng.choice("\x00\n\\\"'[]{}=.,é�") + lines[k][at:]
    return "\n".join(lines)


@pytest.mark.slow
def test_scenarios_maps_and_campaign_files(tmp_path):
    scenarios = [p.read_text() for p in files("cosim").joinpath("scenarios").iterdir() if p.name.endswith(".toml")]
    campaigns = [p.read_text() for p in files("cosim").joinpath("campaigns").iterdir() if p.name.endswith(".toml")]
    for p in files("cosim").joinpath("campaigns").iterdir():
        if p.name.endswith(".csv"):
            (tmp_path / p.name).write_bytes(p.read_bytes())
    maps = [(Path(__file__).parent / "data" / "foreign_map.toml").read_text()]
    path = tmp_path / "case.toml"

    def written(texts):
        def make(rng):
            path.write_text(mangled(rng, rng.choice(texts)), encoding="utf-8", errors="surrogatepass")
            return path

        return make

    def override(rng):
        return f"{rng.choice(KEYS)}={rng.choice(WORDS)}"

    tried("scenarios", CASES, written(scenarios), [cosim.load_scenario])
    tried("overrides", CASES, override, [lambda text: cosim.load_scenario("liquid-ofc", [text])])
    tried("campaign files", CASES, written(campaigns), [load_campaign])
    tried("maps", CASES, written(maps), [load_map])


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    path = tmp_path_factory.mktemp("doors") / "flight.mcap"
    short = ["duration_s=0.5", "faults.0.start_s=0.2", "detectors.enabled=['iotsekf']", "elevator.feedback=measured"]
    cosim.simulate(cosim.load_scenario("liquid-ofc", short), log=path, timed=False)
    return path


@pytest.mark.slow
def test_logs_mutated_and_forged(flight, tmp_path):
    data, log = flight.read_bytes(), open_log(flight)
    texts = {n: v for n, v in log.attachments.items() if n in ("scenario.toml", "detectors.json")}
    arrays = [n for n in log.attachments if n.endswith(".npy")]
    path = tmp_path / "case.mcap"

    def mutated(rng):
        out = bytearray(data)
        for _ in range(rng.choice((1, 1, 2, 5))):
            at, n = rng.randrange(len(out)), rng.choice((1, 1, 8, 100))
            if rng.random() < 0.7:
                out[at : at + n] = rng.randbytes(n)
            elif rng.random() < 0.5:
                del out[at : at + n]
            else:
                out[at:at] = rng.randbytes(n)
        path.write_bytes(reseal(bytes(out)) if rng.random() < 0.7 else bytes(out))
        return path

    def forged(rng):
        what = rng.random()
        if what < 0.35:
            name = rng.choice(list(texts))
            text = texts[name].decode()
            if name.endswith(".toml"):
                change = {name: mangled(rng, text).encode("utf-8", "surrogatepass")}
            else:
                found = json.loads(text)
                entry = rng.choice(found)
                entry[rng.choice(list(entry))] = rng.choice(STRANGE)
                change = {name: json.dumps(rng.choice([found, entry, found * 2, None, [entry]])).encode()}
            return forge(log, path, attachments=change)
        if what < 0.7:
            name = rng.choice(arrays)
            raw = bytearray(log.attachments[name])
            for _ in range(3):
                at = rng.randrange(len(raw))
                raw[at : at + 8] = rng.choice([rng.randbytes(8), np.float64(rng.choice(NUMBERS)).tobytes()])
            cut = len(raw) if rng.random() < 0.8 else rng.randrange(200)
            return forge(log, path, attachments={name: bytes(raw[:cut])})
        if what < 0.9:
            topic = rng.choice(list(log.topics.values()))
            return forge(log, path, samples=[(topic.name, rng.choice(topic.fields), rng.choice(NUMBERS))])
        key = rng.choice(["detectors", "achieved", "status", "reason", "sim_time_s"])
        return forge(log, path, result={key: rng.choice(["null", "[", "9" * 500, "{}", "nan", "é"])})

    doors = [log_info, replay, lambda p: flight_report(p, tmp_path / "page.html")]
    tried("forged logs", CASES, forged, doors)
    tried("mutated logs", CASES, mutated, [*doors, lambda p: recover(p, tmp_path / "recovered.mcap")])


@pytest.mark.slow
def test_recordings(tmp_path):
    (tmp_path / "map.toml").write_text(
        "rate_hz = 200\n[flight]\nmass_t = 200.0\ncg_pct = 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n[signals]\n"
        'de_cmd = { channel = "cmd", unit = "deg" }\n"left_inner.surface" = { channel = "surf", unit = "deg" }\n'
    )
    rows = [f"{k * 0.005:.3f},{np.sin(k / 50):.4f},{np.cos(k / 50):.4f}" for k in range(400)]
    path = tmp_path / "case.csv"

    def made(rng):
        lines = ["t_s,cmd,surf", *rows]
        for _ in range(rng.randint(1, 4)):
            k = rng.randrange(len(lines))
            cells = lines[k].split(",")
            cells[rng.randrange(len(cells))] = rng.choice([*WORDS[:8], "", "-", "é", "1e400", "0.1", ";", '"', "\x00"])
            lines[k] = rng.choice([",".join(cells), lines[0], "", lines[-1], ",,,,,,,", ",".join(cells)])
        if rng.random() < 0.1:
            lines = lines[: rng.randrange(5)]
        path.write_text("\n".join(lines), encoding="utf-8")
        return path

    how = lambda rng: rng.choice([None, "split", "offset"])  # noqa: E731
    rng = random.Random(7)
    tried("recordings", max(200, CASES // 10), made, [lambda p: diagnose(p, tmp_path / "map.toml", on_reset=how(rng))])
