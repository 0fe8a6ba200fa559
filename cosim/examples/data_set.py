"""Make a labelled data set of a small campaign, and load it: pandas, DuckDB and PyTorch, three lines each.

DuckDB and PyTorch are installed by whoever wants them (pip install duckdb torch).
"""

from importlib.util import find_spec
from pathlib import Path

from cosim.campaign.engine import run_campaign

CAMPAIGN = """
title = "Oscillations and jams of one elevator segment"
base = "liquid-ofc"
runs = 1
[set]
duration_s = 15.0
"faults.0.start_s" = 6.0
"detectors.enabled" = []
[grid]
point = [{ name = "heavy", "flight.mass_t" = 320.0, "flight.cas_kt" = 260.0 }, { name = "default" }]
"faults.0.frequency_hz" = [0.5, 2.0]
"""

if __name__ == "__main__":  # workers are processes of their own, which read this file
    Path("oscillations.toml").write_text(CAMPAIGN)
    words = ["rod", "valve_command", "q"]
    done = run_campaign("oscillations.toml", out="oscillations", resume=True, signals=words)

    import pandas as pd

    runs = done.frame.query("split == 'train'")["run"].unique()
    frame = pd.concat([pd.read_parquet(f"oscillations/signals/{run}.parquet").assign(run=run) for run in runs])
    print(frame.groupby("fault_kind")["achieved_left_inner"].agg(["size", "std"]))

    if find_spec("duckdb"):
        import duckdb

        of = "from 'oscillations/signals/*.parquet'"
        print(duckdb.sql(f"select fault_kind, count(*), max(abs(achieved_left_inner)) {of} group by 1 order by 1"))

    if find_spec("torch"):
        import torch

        x = torch.from_numpy(frame[["left_inner.rod", "left_inner.valve_command", "q"]].to_numpy())
        y = torch.from_numpy((frame["faults_active"] > 0).to_numpy())
        print(x.shape, y.float().mean())
