"""What a campaign says of itself: its result in a notebook, and draws of a fault that is not there."""

import pandas as pd
import pytest

from cosim.campaign.flights import CampaignResult
from cosim.campaign.spec import load_campaign
from cosim.campaign.store import Store
from cosim.errors import CosimError

EMPTY = '''
base = "liquid-ofc"
[set]
faults = []
[draw]
"faults.0.amplitude_mm" = { low = 1.0, high = 2.0 }
'''


def test_a_draw_of_a_fault_that_faults_empty_takes_away_says_so(tmp_path):
    (tmp_path / "c.toml").write_text(EMPTY)
    with pytest.raises(CosimError, match=r"faults = \[\]` of base, \[set\] or \[grid\] wins over what \[draw\]"):
        load_campaign(str(tmp_path / "c.toml")).scenarios()


def test_a_result_prints_counts_and_shows_a_table_in_a_notebook():
    rows = {"status": ["completed", "infeasible"], "id": ["rfafe", None],
            "level": ["aircraft", None], "concerned": [True, None],
            "delay_s": [1.0, None], "false_alarms": [2, None]}  # fmt: skip
    store = Store(None, pd.DataFrame({"run": ["a", "b"], "order": [0, 1]}))
    store.add([{"run": r, "lane": 0, **dict(zip(rows, row))} for r, *row in zip(["a", "b"], *rows.values())], [])
    result = CampaignResult(store, {"a": "completed", "b": "infeasible"})
    assert repr(result) == "CampaignResult: 2 runs (1 completed, 1 infeasible), detectors rfafe, no folder"
    assert "<td>rfafe</td>" in result._repr_html_().replace(' class="n"', "")
