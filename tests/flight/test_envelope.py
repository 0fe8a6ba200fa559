"""The envelope: what is in hand at a point or why there is none, its page, its picture, its numbers."""

import io
import math
import re

import pytest
from rich.console import Console

from cosim.campaign.envelope import REASONS, STALL_MOMENT, reach, summary, trim_map
from cosim.cli.envelope import envelope, shown
from cosim.errors import CosimError
from cosim.report import envelope_report
from cosim.report.envelope_page import REASON


@pytest.fixture(scope="module")
def trims():
    return trim_map((260.0, 320.0), (25.0, 36.0), (20000.0, 38000.0), (150, 170, 210, 270, 330, 350, 390))


def test_point_says_what_is_in_hand_or_why_it_has_no_trim(trims):
    at = trims[(trims["mass_t"] == 320.0) & (trims["cg_pct"] == 25.0)].set_index(["altitude_ft", "cas_kt"])
    assert at.loc[(20000.0, 150.0), "reason"] == "stall"
    assert at.loc[(38000.0, 170.0), "reason"] == "thrust"
    assert at.loc[(38000.0, 350.0), "reason"] == "speed" and "Mach" in at.loc[(38000.0, 350.0), "why"]
    assert at.loc[(20000.0, 270.0), "reason"] == ""
    # the hydraulic actuator stalls short of full travel from about 330 kt on, upward first
    assert at.loc[(20000.0, 270.0), "hydraulic_up_deg"] == -23.0
    assert -22.0 < at.loc[(20000.0, 330.0), "hydraulic_up_deg"] < -18.0
    assert at.loc[(20000.0, 350.0), "hydraulic_down_deg"] < 17.0
    assert at.loc[(20000.0, 350.0), "ema_up_deg"] == -23.0 and -23.0 < at.loc[(20000.0, 390.0), "ema_up_deg"] < -18.0


def test_forward_cg_takes_more_stabiliser(trims):
    fore, aft = (trims[(trims["cg_pct"] == cg) & (trims["reason"] == "")].set_index(["mass_t", "altitude_ft", "cas_kt"])
                 for cg in (25.0, 36.0))  # fmt: skip
    both = fore.index.intersection(aft.index)
    assert len(both) > 15
    assert (fore.loc[both, "stabilizer_deg"] < aft.loc[both, "stabilizer_deg"] - 0.2).all()


def test_stall_moments_are_those_of_the_actuators():
    assert STALL_MOMENT["hydraulic"] == pytest.approx(35e3 * 0.30, rel=0.01)  # [Lu17] 35 kN
    assert STALL_MOMENT["ema"] == pytest.approx(1.5 * 10.5e3)
    up, down = reach(1000.0, -30000.0, 10500.0)  # M = HM0 + HM_delta delta is +10.5 kN m going up, -10.5 going down
    assert 1000.0 - 30000.0 * math.radians(up) == pytest.approx(10500.0)
    assert 1000.0 - 30000.0 * math.radians(down) > -10500.0 and down == pytest.approx(17.0)


@pytest.mark.slow
def test_processes_give_the_same_map():
    few = ((320.0,), (30.0,), (0.0, 20000.0), (150, 270))
    done = []
    assert trim_map(*few, workers=2, progress=lambda n, of: done.append((n, of))).equals(trim_map(*few))
    assert done[-1] == (4, 4)


def test_summary_counts_and_tells_where_travel_is_lost(trims):
    found = summary(trims)
    assert found["points"] == 56 and found["trimmed"] + sum(found["reasons"].values()) == 56
    assert set(found["reasons"]) == {"stall", "thrust", "speed"} < set(REASONS) < set(REASON)
    assert found["stalls"]["hydraulic"]["up"]["from_kt"] == 330.0
    assert found["stalls"]["hydraulic"]["down"]["from_kt"] == 350.0
    assert found["stalls"]["ema"]["down"] == {"from_kt": None, "reach_deg": 17.0}
    assert [m["mass_t"] for m in found["masses"]] == [260.0, 320.0]
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(shown(found | {"report": "a", "table": "c"}))
    assert "hydraulic: full elevator up below 330 kt CAS" in console.export_text()


def test_a_campaign_that_is_not_there_is_refused_before_anything_is_trimmed(tmp_path, monkeypatch):
    monkeypatch.setattr("cosim.campaign.envelope.trim_map", lambda **_: pytest.fail("trimmed"))
    with pytest.raises(CosimError, match="nowhere"):
        envelope(output=tmp_path / "out", flown=tmp_path / "nowhere", workers=1)


def test_the_page_shows_every_quantity_and_every_reason(trims, tmp_path):
    page = envelope_report(trims, summary(trims), tmp_path / "envelope.html").read_text()
    for word in ("Trim angle of attack", "Stabiliser in trim", "Throttle", "hydraulic segment goes up"):
        assert word in page
    assert "electromechanical segment goes down" not in page  # it reaches all of its travel everywhere
    assert 'src="http' not in re.sub(r"<script>.*?</script>", "", page, flags=re.S)
    assert all(word in page for word in ("320 t, CG 25 %", *(REASONS[name] for name in ("stall", "thrust", "speed"))))
