"""Detection and validity over the envelope, from the rows of a campaign."""

import io

import pandas as pd
import pytest
from rich.console import Console

from cosim.compare import over_envelope as module
from cosim.compare.over_envelope import over_envelope, weakest


@pytest.fixture
def found(monkeypatch):
    """Nine flights, 200 to 280 t at one speed; the detector sees the light ones and is not valid in the heaviest."""
    masses = {f"r{k}": 200.0 + 10.0 * k for k in range(9)}
    rows = [{"run": run, "id": "d", "family": "jam", "word": "designed", "concerned": True, "detected": mass < 245.0,
             "valid_share": 0.0 if mass == 280.0 else 1.0} for run, mass in masses.items()]  # fmt: skip
    blind = [row | {"word": "blind", "id": "b"} for row in rows]
    monkeypatch.setattr(module.compare_rows, "tidy", lambda *_: pd.DataFrame(rows + blind))
    tomls = {run: f"[flight]\nmass_t = {mass}\ncas_kt = 250.0\n" for run, mass in masses.items()}
    return over_envelope(pd.DataFrame(), tomls)


def test_every_axis_is_cut_into_parts_of_equally_many_flights(found):
    mass = found[found["axis"] == "mass_t"]
    assert mass[["low", "high"]].to_numpy().tolist() == [[200.0, 220.0], [230.0, 250.0], [260.0, 280.0]]
    assert mass["faults"].tolist() == [3, 3, 3] and mass["seen"].tolist() == [3, 2, 0]
    assert mass["valid_share"].tolist() == pytest.approx([1.0, 1.0, 2.0 / 3.0])
    speed = found[found["axis"] == "cas_kt"]
    assert len(speed) == 1 and (speed["faults"].item(), speed["seen"].item()) == (9, 5)
    assert set(found["id"]) == {"d"} and "altitude_ft" not in set(found["axis"])


def test_the_table_says_where_least_is_seen_and_where_least_is_valid(found):
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(weakest(found))
    text = console.export_text()
    assert "5/9" in text and "0/3" in text and "260 to 280 t" in text and "67%" in text
    even = found.assign(seen=found["faults"], valid_share=1.0)
    console.print(weakest(even))
    assert "9/9" in (text := console.export_text()) and " t " not in text  # no part is named where all do alike


def test_the_table_of_the_longest_words_is_one_table_in_80_columns(found):
    many = found.assign(id="learned_convolution", family="aircraft's sensor", axis="altitude_ft")
    many[["low", "high", "faults", "seen"]] = 10000.0, 39000.0, 1200, 1000
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(weakest(many))
    text = console.export_text()
    assert text.count("learned_convolution") == 1 and "there" in text and "left out" not in text
