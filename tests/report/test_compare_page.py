"""The page of a comparison: figures where there is something to draw, cells in the colour of what happened."""

import numpy as np
import pandas as pd
import pytest
from report_browser import CHROMIUM, use

from cosim.campaign.engine import run_many
from cosim.compare import compare, stats
from cosim.report import compared, write_comparison
from cosim.report.compare_page import matrix, render
from cosim.scenario import load_scenario

CHOSEN = "detectors.enabled=['iotsekf','position_monitor','rfafe']"


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Return the Comparison of two oscillations and a flight without a fault."""
    base = ["duration_s=7", "faults.0.start_s=3", CHOSEN, "seed=1000001"]
    flights = [load_scenario("liquid-ofc", [*base, f"faults.0.amplitude_mm={mm}"]) for mm in (1.0, 8.0)]
    folder = tmp_path_factory.mktemp("campaign")
    run_many([*flights, load_scenario("cruise", ["duration_s=7", CHOSEN])], workers=0, out=folder)
    return compare([folder])


def test_the_first_sentence_counts_faults_by_level_as_the_table_does(found):
    (told,) = found.levels
    said = f"Of 2 faults the local level alone saw {told['local']}, the aircraft level alone {told['aircraft']}"
    assert said in render(found)
    alarming = [found.detectors[0] | {"credible": False}, *found.detectors[1:]]
    loud = type(found)(found.rows, alarming, found.runs, 0, "")
    assert f"alarms in more than half of the fault-free flights: {alarming[0]['id']}" in render(loud)


def test_a_comparison_without_a_designed_for_fault_has_no_empty_figure(found):
    rows = found.rows
    blind = rows.assign(word=np.where(rows["case"].notna(), "may", rows["word"]))
    assert compared.delays(blind) is None and compared.roc(blind, stats.detectors(blind)) is None
    assert compared.delays(rows) and compared.roc(rows, stats.detectors(rows)) and compared.maps(rows)
    assert compared.maps(rows[rows["case"].isna()]) is None and matrix(rows[rows["case"].isna()]) is None


def test_a_cell_of_wrong_names_only_has_their_colour(found):
    wrong = found.rows.assign(outcome=found.rows["outcome"].where(found.rows["outcome"].isna(), "misnamed"))
    assert "c-wrong" in str(matrix(wrong).__html__())
    mixed = pd.concat([wrong, found.rows.assign(outcome=wrong["outcome"].where(wrong["outcome"].isna(), "named"))])
    assert "c-part" in str(matrix(mixed).__html__())


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_browser_draws_every_figure_of_a_comparison(found, tmp_path):
    write_comparison(found, tmp_path / "out")
    used = use(found.report, tmp_path, width=700)
    assert used["errors"] == [] and used["requests"] == [] and not used["overflow"]
    assert [p["id"] for p in used["plots"]] == ["maps", "delays", "roc"]
    assert all(p["svg"] and p["traces"] and p["marks"] for p in used["plots"])
    assert used["theme"][2] != used["theme"][3]
    assert used["toggle"]["off"] == 0 < used["toggle"]["before"] == used["toggle"]["on"]
