"""Every mistake of a user's file is named at once, each with its line, or with the override that made it."""

import pickle

import pytest

from cosim.campaign.spec import load_campaign
from cosim.errors import CosimError
from cosim.replay.map_file import load_map
from cosim.scenario import load_scenario
from cosim.texts import toml_lines

SCENARIO = """\
[flight]
mas_t = 300.0            # 2: slip of a key
cg_pct = 90.0            # 3: out of range
altitude_ft = 20000.0
cas_kt = 240.0

[elevator]
left_inner = "emma"      # 8: no technology

[[faults]]
target = "sensor.alpha"
kind = "bias"
start_s = -1.0           # 13: field of the model

[[faults]]
target = "sensor.alpha"
kind = "bias"
start_s = 1.0
bias_deg = "big"         # 19: number of the catalog
"""


def lines(load, *args):
    """Return the lines of the error that `load(*args)` raises."""
    with pytest.raises(CosimError) as caught:
        load(*args)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    return str(caught.value).splitlines()


def test_a_scenario_names_every_mistake_with_its_line(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(SCENARIO)
    found = lines(load_scenario, path, ["duration_s=-1", "seed", "elevator.feedbak=3"])
    wanted = (
        "--set seed: is not of the form",
        f"{path}:2: flight.mas_t = 300.0: unknown key",
        f"{path}:3: flight.cg_pct = 90.0: is out of range",
        f'{path}:8: elevator.left_inner = "emma": ',
        f"{path}:13: faults.0.start_s = -1.0: ",
        f'{path}:19: faults.1.bias_deg = "big"',
        f"{path}: --set duration_s = -1: is out of range",
        f"{path}: --set elevator.feedbak = 3: unknown key",
    )
    assert len(found) == len(wanted), found
    assert all(line.startswith(start) for line, start in zip(found, wanted)), found


def test_an_unknown_key_may_have_the_name_of_a_manoeuvre(tmp_path):
    path = tmp_path / "mine.toml"
    point = "mass_t = 200.0\ncg_pct = 30.0\naltitude_ft = 20000.0\ncas_kt = 290.0\n"
    path.write_text(f"cruise = 30.0\n[flight]\n{point}nz_doublet = 1\n")
    said = [line.split(": ")[1].split(" =")[0] for line in lines(load_scenario, path)]
    assert said == ["cruise", "flight.nz_doublet"]


def test_a_campaign_names_every_mistake_with_its_line(tmp_path):
    path = tmp_path / "many.toml"
    grid = "[grid]\n'flight.mass_t' = []\n[draw]\n'flight.cg_pct' = {low = 9}\n"
    path.write_text(f"rnus = 2\n[set]\nseed = 3\n{grid}")
    assert [line.split(": ")[0] for line in lines(load_campaign, path)] == [f"{path}:{n}" for n in (1, 5, 7)]
    path.write_text("rnus = 2\n[set]\nduration_s = -1\n[grid]\nseed = [1, 2]\n'flight.mass_t' = [200, 9000]\n")
    found = lines(load_campaign, path)
    assert [line.split(": ")[:2] for line in found[1:]] == [
        [f"{path}:3", "duration_s = -1"], [f"{path}:6, run 1", "flight.mass_t = 9000"]
    ]  # fmt: skip


def test_a_map_names_every_mistake_with_its_line(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text("rate_hz = 3\ntilte = 'x'\n[signals]\nalpha = { channel = 'a', unt = 'deg' }\n")
    assert [line.split(": ")[0] for line in lines(load_map, path)] == [f"{path}:{n}" for n in (1, 2, 4)]


def test_keys_below_headings_and_in_long_values_have_their_line():
    found = toml_lines('''a = """
[no.table]
"""
"b.c" = [1,
  { d = 2, e.f = [3,
    4] },
]   # g = 5
[[h.i]]
k = 1
[[h.i]]
[[h.i.l]]
m = -inf
''')
    assert {".".join(key): line for key, line in found.items()} == {
        "a": 1, "b.c": 4, "b.c.0": 4, "b.c.1": 5, "b.c.1.d": 5, "b.c.1.e": 5, "b.c.1.e.f": 5, "b.c.1.e.f.0": 5,
        "b.c.1.e.f.1": 6, "h": 8, "h.i": 8, "h.i.0": 8, "h.i.0.k": 9, "h.i.1": 10, "h.i.1.l": 11, "h.i.1.l.0": 11,
        "h.i.1.l.0.m": 12,
    }  # fmt: skip
