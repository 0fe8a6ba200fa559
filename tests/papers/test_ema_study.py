"""The EMA study: what its flights return, and that its questions make tables of what its jobs return."""

import pytest

from cosim.campaign.jobs import work
from cosim.papers.studies import Options, ema, ema_flights

QUESTIONS = {p.name: p for p in ema.questions()}


def test_a_position_fault_in_flight_is_named_and_the_loop_closed_on_the_estimate():
    found = ema_flights.position_fault("position + 15 deg", 11)
    assert found["named"] == "position" and found["delay_s"] < 0.3 and found["valid"]
    assert found["dnz"] < 0.04 < 0.1 < found["dnz_without"]
    assert found["surface_deg"] < 0.5


@pytest.mark.parametrize("path", ["loop", "monitor"])
def test_a_current_bias_never_reconfigures_and_is_named_where_only_the_monitor_has_it(path):
    found = ema_flights.loop_fault("current + 10 % of stall", 11, path)
    assert not found["reconfigured"]
    assert found["names"][-1] in (("none", "ambiguous") if path == "loop" else ("sensor current",))


@pytest.mark.parametrize("name", ["confusion", "smallest", "bias"])
def test_bench_parts_make_tables(name):
    options = Options(seeds=1)
    question = QUESTIONS[name]
    [(title, columns, rows)] = question.tables(options, work(question.jobs(options), workers=0))
    assert title and rows and all(len(row) == len(columns) for row in rows)
    if name == "bias":
        assert all(row[2] == 0 for row in rows)  # reconfigured
    if name == "confusion":
        assert [row[2] for row in rows].count("1/1") >= len(rows) - 1
