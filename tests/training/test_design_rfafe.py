"""Stored Sun13 designs: they still hold and are wired whole."""

import itertools
import json

import numpy as np
import pytest

from cosim.flight.detection.detectors import sources
from cosim.flight.loop.bus import Bus
from cosim.scenario.catalog import SEGMENTS
from cosim.training import designs as design
from cosim.training import rfafe as training
from cosim.training.__main__ import main
from fdi.common import tuning
from fdi.rfafe import rfafe, rfafe_airframe
from fdi.rfafe.store import choose, from_plain, read, side_kinds

FORMS = {"rfafe": rfafe, "rfafe_airframe": rfafe_airframe}


def test_a_spoilt_or_missing_design_is_told(tmp_path):
    (tmp_path / "rfafe.json").write_text((design.FOLDER / "rfafe.json").read_text().replace("0.005", "0.006", 1))
    (tmp_path / "lpv_smo.json").write_text((design.FOLDER / "lpv_smo.json").read_text())
    found = design.check(folder=tmp_path)
    assert found["lpv_smo"] == "" and "spoilt" in found["rfafe"] and "not there" in found["lpv_smo_boxes"]


def test_what_is_stored_reads_back_also_tuples_with_words():
    data = {"refused": [((260.0, 28.0), "270 kt at M 0.40 is an altitude of -357 m")] * 8}
    assert json.loads(tuning.text(data)) == json.loads(json.dumps(data))


def test_the_command_looks_at_every_design(capsys):
    assert main(["designs", "--check"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told == [f"{name}: belongs to this aircraft" for name in design.MAKERS]


def test_the_actuator_of_a_design_is_measured_in_flight(monkeypatch):
    monkeypatch.setattr(training, "FIT_HZ", (0.5, 1.0, 2.0))  # of nine
    found = training.actuator.__wrapped__("hydraulic")
    held = read("rfafe_airframe")["designs"]["hydraulic"]["actuator"]
    wanted = (held["a_rad_s"], held["gain"], held["tau_s"])
    assert found == pytest.approx(wanted, rel=0.1, abs=0.015)


@pytest.mark.parametrize("name", sorted(FORMS))
def test_stored_matrices_hold_when_substituted_back(name):
    for technology, entry in read(name)["designs"].items():
        d = from_plain(entry["design"])
        PN, TF = d.P @ d.N, d.T @ d.F
        i31 = PN + PN.T + 2 * d.region.decay * d.P
        assert np.linalg.eigvalsh(i31)[-1] <= 1e-6 * np.linalg.norm(i31, 2), technology
        assert np.linalg.norm(TF.T @ d.P - d.M @ d.C) <= 1e-6 * np.linalg.norm(TF.T @ d.P)
        assert np.linalg.norm((np.eye(len(d.A)) - d.H @ d.C) @ d.E) <= 1e-10
        assert d.region.holds(np.linalg.eigvals(d.N)).all()
        assert (np.linalg.norm(d.T @ d.F, axis=0) >= 0.5 * np.linalg.norm(d.F, axis=0)).all()
        FORMS[name].params(technology=technology)


@pytest.mark.parametrize("name", sorted(FORMS))
def test_every_input_is_wired(name):
    bus = Bus([("x", FORMS[name].INPUTS, ("aircraft",))])
    assert {c for c, _ in bus.columns("x", "aircraft")} == set(sources(name))


@pytest.mark.parametrize("kinds", list(itertools.product(["hydraulic", "ema", "simple"], repeat=4)))
def test_every_elevator_has_a_design_of_its_own(kinds):
    """81 of them: each side is one of four kinds (mixed where its segments differ), each pair has its entry."""
    key = side_kinds(dict(zip(SEGMENTS, kinds)))
    left, right = (kinds[i] if kinds[i] == kinds[i + 1] else "mixed" for i in (0, 2))
    assert key == (left if left == right else f"{left}/{right}")
    assert choose(read("rfafe"), key, 0.005)[1] == read("rfafe")["designs"][key]
    total = key if "/" not in key else "mixed"  # the airframe form knows no sides
    assert choose(read("rfafe_airframe"), key, 0.005)[1] == read("rfafe_airframe")["designs"][total]


def test_sides_that_differ_have_an_actuator_each():
    p = FORMS["rfafe"].params(technology="hydraulic/ema")
    alone = [FORMS["rfafe"].params(technology=kind) for kind in ("hydraulic", "ema")]
    for i, one in enumerate(alone):
        assert p["act_a"][0, i] == one["act_a"][0, 0] and p["u_delay"][0, i] == one["u_delay"][0, 0]
    assert (p["servo"][0, 0] != p["servo"][0, 2]).any() and p["act_a"][0, 0] != p["act_a"][0, 1]
