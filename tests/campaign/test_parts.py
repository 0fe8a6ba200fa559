import random
from unittest.mock import patch

import pandas as pd
import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from cosim.campaign import parts
from cosim.campaign.store import Store
from cosim.campaign.worker import Packed, failed
from cosim.scenario import load_scenario

FEW = pa.schema([parts.ROWS.field(name) for name in ("run", "lane", "status", "r_max_before")])


@given(runs=st.integers(1, 40), each=st.integers(1, 7), block=st.integers(1, 9), seed=st.integers(0, 99))
def test_parts_in_any_order_give_whole_runs_in_order_whatever_the_size_of_a_block(
    tmp_path_factory, runs, each, block, seed
):
    """Runs finish in any order, some rows are there twice, one run belongs to another campaign. A few columns will do:
    with all hundred the same takes fifteen times as long."""
    folder, draw = tmp_path_factory.mktemp("parts"), random.Random(seed)
    (folder / "parts").mkdir()
    names = [f"r{i:03}" for i in range(runs)] + ["other"]
    draw.shuffle(names)
    batches = [names[i : i + each] for i in range(0, len(names), each)]
    order = {f"r{i:03}": i for i in range(runs)}
    with patch.object(parts, "BLOCK", block), patch.dict(parts.KINDS, rows=FEW):
        for n, batch in enumerate([*batches, draw.choice(batches)]):
            rows = [{"run": run, "lane": lane, "status": "completed"} for run in batch for lane in range(3)]
            parts.add(folder, "rows", str(n), rows)
            if n == len(batches) // 2:
                parts.merge(folder, "rows")
        found = list(parts.ordered(folder, "rows", order))
    assert [run for f in found for run in dict.fromkeys(f["run"].sort_values())] == list(order)
    assert [{order[run] // block for run in f["run"]} for f in found] == [{k} for k in range(-(-runs // block))]
    whole = pd.concat(found).drop_duplicates(["run", "lane"])
    assert len(whole) == 3 * runs and set(whole["run"]) == set(order)


def test_rows_written_in_blocks_are_those_written_at_once(tmp_path):
    speed = [1.5 * i for i in range(30)]
    scenarios = pd.DataFrame({"run": [f"r{i}" for i in range(30)], "order": range(30), "speed": speed})
    for block in (4, 2000):
        store = Store(tmp_path / str(block), scenarios, ["x"] * 30)
        for i in random.Random(block).sample(range(30), 30):
            store.add([failed(f"r{i}", "infeasible" if i % 3 else "error", "") | {"lane": 0}], [])
        with patch.object(parts, "BLOCK", block):
            status = store.consolidate(tmp_path / str(block))
        assert status == {f"r{i}": "infeasible" if i % 3 else "error" for i in range(30)}
    small, large = (pd.read_parquet(tmp_path / str(block) / "runs.parquet") for block in (4, 2000))
    pd.testing.assert_frame_equal(small, large)
    assert list(small["speed"]) == list(scenarios["speed"])


def test_a_packed_scenario_is_the_scenario_and_small():
    several = [load_scenario("liquid-ofc", [f"seed={i}"]) for i in range(3)]
    packed = Packed(several)
    assert list(packed) == several and packed[1:] == several[1:] and [p.seed for p in packed.held] == [0, 1, 2]
    assert max(len(p.data) for p in packed.held) < 4000
