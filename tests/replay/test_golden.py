"""Golden flights: the recorded ones replay bit for bit, their faults trip alarms, their numbers are as reviewed."""

import pytest
from fingerprint import fingerprint
from golden import FLIGHTS, FOLDER, fly

from cosim.errors import LogError
from cosim.log import open_log
from cosim.replay import replay

EARLIER = FOLDER / "earlier"  # of the last release: older noise
# on purpose since then: another state or other outputs
LAYOUT = {
    *("lpv_smo", "ofc_monitor", "ema_kalman", "ema_kalman_flight", "iotsekf"),
    *("position_monitor", "rfafe", "rfafe_airframe", "rtsekf", "rtsekf_flight"),
}
flown = pytest.mark.parametrize(
    ("name", "folder"), [(n, f) for f in (FOLDER, EARLIER) for n in FLIGHTS if (f / f"{n}.mcap").is_file()],
    ids=lambda value: getattr(value, "name", value),
)  # fmt: skip


def test_every_golden_flight_is_there():
    assert {p.stem for p in FOLDER.glob("*.mcap")} == set(FLIGHTS)
    assert {p.stem for p in EARLIER.glob("*.mcap")} == set(FLIGHTS)


@flown
def test_a_golden_flight_replays_bit_for_bit_and_alarms(name, folder):
    path, changed = folder / f"{name}.mcap", LAYOUT if folder == EARLIER else set()
    ids = [d for d in FLIGHTS[name].detectors if d not in changed]
    if not ids:
        with pytest.raises(LogError, match="another layout"):
            replay(path, detectors=[d for d in FLIGHTS[name].detectors if d in LAYOUT])
        return
    r = replay(path, detectors=ids)
    assert r.exact, f"{r.differences[:5]}: meant? `python tests/helpers/golden.py` writes them anew"
    assert {d["id"] for d in r.detectors} == set(ids)
    for d in r.detectors:
        if d["id"] in FLIGHTS[name].alarmed and d["replayed"]["concerned"]:
            assert d["replayed"]["detected_at_s"] is not None, d["id"]
            assert d["replayed"]["isolated"] is not None, d["id"]
    assert replay(path, detectors=ids, start_s=2.7).exact


@flown
def test_the_fingerprint_is_that_of_the_log(name, folder):
    path = folder / f"{name}.mcap"
    assert path.with_suffix(".txt").read_text() == fingerprint(open_log(path))
    assert path.stat().st_size < 900_000 and path.with_suffix(".txt").stat().st_size < 20_000
    assert open_log(path).complete


def test_the_command_writes_a_flight_that_replays(tmp_path):
    first, second = (fly("ema-position-bias", tmp_path / n) for n in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()
    assert replay(first).exact
