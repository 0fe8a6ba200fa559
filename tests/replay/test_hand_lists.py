"""Drafted maps against lists written by hand: which channel of each public set is which signal, in which unit and sign.

The sets belong to others. Here a flight of the testbed is written with their names, units and signs, and the channels
that have no counterpart as noise. With COSIM_REAL=DIR the same lists judge the drafts of the real files below DIR.
"""

import os
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from real_flights import MAPS

import cosim
from cosim.replay.log_schema import ReplayError
from cosim.replay.map import diagnose
from cosim.replay.map_draft import draft
from cosim.replay.map_file import load_map
from cosim.replay.units import factors
from cosim.scenario.vocabulary import words

DEG = dict.fromkeys(("alpha", "beta", "phi", "theta", "psi", "de_cmd"), "deg") | dict.fromkeys("pqr", "deg/s")
DEG |= dict.fromkeys(("pdot", "qdot", "rdot"), "deg/s2")
ATTAS = {
    "AXCG": "n_x", "AYCG": "n_y", "AZCG": "-n_z", "PRGX": "p", "QRGY": "q", "RRGZ": "r", "PHI": "phi", "THE": "theta",
    "PSI": "psi", "ALCG": "alpha", "BECG": "beta", "VTASCG": "tas", "HQNH": "h_baro", "PDOT": "pdot", "QDOT": "qdot",
    "RDOT": "rdot", "VCAS": "cas", "DELV": "de_cmd", "IHTRM": "stab_cmd", "N1T1L": "n1_1", "N1T2R": "n1_2",
    "DRUD": "dr_cmd", "MACH": "mach",
}  # fmt: skip
HFB = {
    "DELV": "de_cmd", "TASCG": "tas", "ALFCG": "alpha", "THE": "theta", "Q": "q", "QDOT": "qdot", "AXCG": "n_x",
    "AZCG": "-n_z", "AYCG": "n_y", "P": "p", "R": "r", "PDOT": "pdot", "RDOT": "rdot", "BETCG": "beta", "PHI": "phi",
    "DAIL": "da_cmd", "DRUD": "dr_cmd",
}  # fmt: skip
CITATION = {
    "vane_AOA": "alpha", "delta_e": "de_cmd", "delta_a": "da_cmd", "delta_r": "dr_cmd", "Ahrs1_Pitch": "theta",
    "Ahrs1_Roll": "phi", "Ahrs1_bPitchRate": "q", "Ahrs1_bRollRate": "p", "Ahrs1_bYawRate": "r",
    "Ahrs1_bLongAcc": "n_x", "Ahrs1_bLatAcc": "n_y", "Ahrs1_bNormAcc": "n_z", "Dadc1_tas": "tas", "Dadc1_cas": "cas",
    "Dadc1_alt": "h_baro", "Dadc1_altRate": "hdot", "Dadc1_mach": "mach", "lh_engine_fan_N1": "n1_1",
    "rh_engine_fan_N1": "n1_2",
}  # fmt: skip
OTTER = {
    "* airspeed (ft/sec)": "tas", "alpha": "alpha", "beta": "beta", "p": "p", "q": "q", "r": "r", "phi": "phi",
    "theta": "theta", "an": "n_z", "ax": "n_x", "ay": "n_y", "pdot": "pdot", "qdot": "qdot", "rdot": "rdot",
    "* elevator (deg)": "de_cmd", "mach": "mach", "* altitude (ft)": "h_baro", "* mass (slug)": "mass",
}  # fmt: skip
OAT = {  # one of its structures; its surfaces are in counts of the servo, which no number of the file ties to an angle
    "el_1.Va": "tas", "el_1.AoA": "alpha", "el_1.beta": "beta", "el_1.p": "p", "el_1.q": "q", "el_1.r": "r",
    "el_1.roll": "phi", "el_1.pitch": "theta", "el_1.yaw": "psi", "el_1.ax": "n_x", "el_1.ay": "n_y",
    "el_1.az": "-n_z", "el_1.h": "h_baro", "el_1.delta_e": "de_cmd",
}  # fmt: skip
G = {"n_x": "m/s2", "n_y": "m/s2", "n_z": "m/s2"}
N1 = {"n1_1": "%", "n1_2": "%"}
SETS = {  # list, units that are not SI, other channels, whether a detector can judge by the file
    "attas": (ATTAS, {**DEG, **G, **N1, "cas": "kt", "h_baro": "ft"}, True),
    "attas_stall": (ATTAS, {**DEG, **G, **N1}, True),
    "hfb320": (HFB, G, True),
    "citation": (CITATION, {**DEG, **N1, "tas": "kt", "cas": "kt", "h_baro": "ft", "hdot": "ft/min"}, True),
    "twin_otter": (OTTER, {**DEG, "tas": "ft/s", "h_baro": "ft", "mass": "slug"}, True),
    "oat": (OAT, {**G, **{n: "deg" for n in ("alpha", "beta", "phi", "theta", "psi")}}, False),
}
OTHER = {"attas": ("AYCKP", "AZCKP", "DLC_R", "FUELUS", "RHO", "FLAP", "ALDOT"), "hfb320": ("PDYN", "THRUST"),
         "citation": ("Dadc1_sat", "Gps_lat", "column_fe", "lh_engine_itt"), "twin_otter": ("qbar", "d1", "CL", "rho"),
         "oat": ("el_1.u", "el_1.v", "el_1.w", "el_1.delta_t", "el_1.VN")}  # fmt: skip


@cache
def flown():
    """Return {signal: samples at 25 Hz} of 60 s in light turbulence with a doublet, and their times."""
    names = sorted({n.lstrip("-") for own, *_ in SETS.values() for n in own.values()} - {"n1_1", "n1_2"})
    where = {n: f"law.law.{n}" if n.endswith("_cmd") else f"sensors.{n}.y" for n in names}
    keys = ["duration_s=60", "detectors.enabled=[]", "flight.turbulence=light", "manoeuvre.kind=nz_doublet"]
    frame = cosim.fly(cosim.load_scenario("cruise", keys), list(where.values()))
    found = {n: frame[at].to_numpy()[::8] for n, at in where.items()}
    n = len(frame.index[::8])
    sway = np.sin(0.4 * frame.index.to_numpy()[::8])
    return {**found, "n1_1": 85.0 + sway, "n1_2": 86.0 + sway, "t": frame.index.to_numpy()[::8], "rows": n}


def written(name, path):
    """Write the flight with the names, units and signs of a set."""
    own, units, _ = SETS[name]
    flight, rng = flown(), np.random.default_rng(1)
    table = {"T": flight["t"]}
    for channel, word in own.items():
        y, unit = flight[word.lstrip("-")], units.get(word.lstrip("-"), "")
        y = y / factors(words()[word.lstrip("-")].unit)[unit] if unit else y
        table[channel] = -y if word.startswith("-") else y
    if name == "citation":
        table["Ahrs1_bNormAcc"] = table["Ahrs1_bNormAcc"] - 1.0
    if name == "oat":
        table["el_1.delta_e"] = 5000.0 * table["el_1.delta_e"] / 0.1
    others = OTHER.get(name, OTHER["attas"])
    for k, c in enumerate(others):
        table[c] = 5.0 * np.sin(0.3 * flight["t"] + k) + rng.normal(0.0, 0.1, flight["rows"])
    pd.DataFrame(table).to_csv(path, index=False)


def judged(name, text):
    """Return (share of the list that flies right, what flies wrongly) of a drafted map."""
    own, units, _ = SETS[name]
    right, wrong = 0, []
    for word, signal in tomllib.loads(text).get("signals", {}).items():
        channel = signal.get("channel", "").split(" [")[0] if name != "twin_otter" else signal.get("channel", "")
        if not channel:
            continue
        truth = own.get(channel, "")
        good = truth.lstrip("-") == word and signal.get("sign", 1) == (-1 if truth.startswith("-") else 1)
        good = good and signal.get("unit", words()[word].unit) == units.get(word, words()[word].unit)
        good = good and signal.get("offset", 0.0) == (1.0 if channel == "Ahrs1_bNormAcc" else 0.0)
        right += good
        wrong += [] if good else [(channel, word, signal)]
    return right / len(own), wrong


def checked(name, path, text, tmp_path):
    share, wrong = judged(name, text)
    assert not wrong, text
    assert share >= 0.8, (share, text)
    (tmp_path / "map.toml").write_text(text)
    if SETS[name][2]:
        assert diagnose(path, tmp_path / "map.toml").detectors
    else:
        with pytest.raises(ReplayError, match="de_cmd"):
            diagnose(path, tmp_path / "map.toml")


@pytest.mark.parametrize("name", SETS)
def test_a_draft_has_what_the_hand_list_has_and_runs_unchanged(name, tmp_path):
    written(name, tmp_path / "flight.csv")
    text = draft(tmp_path / "flight.csv", aircraft="narrowbody")
    checked(name, tmp_path / "flight.csv", text, tmp_path)


FILES = {"attas": "fAttasElv1.mat", "attas_stall": "fAttas_qst01.asc", "hfb320": "hfb320_1_10.asc",
         "citation": "vane_AOA.csv", "twin_otter": "totter_lon_data.mat",
         "oat": "ProcessedData_2022_05_07_11_13_57.mat"}  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif("COSIM_REAL" not in os.environ, reason="COSIM_REAL=DIR names the folder with the recordings")
@pytest.mark.parametrize("name", FILES)
def test_the_drafts_of_the_real_files_have_what_the_hand_list_has(name, tmp_path):
    path = next(Path(os.environ["COSIM_REAL"]).rglob(FILES[name]))
    path = path.parent if name == "citation" else path
    time = "el_1.time" if name == "oat" else None
    text = draft(path, aircraft="narrowbody", columns=load_map(MAPS / f"{name}.toml")[0].columns, time=time)
    checked(name, path, text, tmp_path)
