"""Fly a small campaign on every core, and count who saw what: a grid and draws over keys of a scenario."""

from pathlib import Path

import cosim
from cosim.campaign.engine import run_campaign

CAMPAIGN = """
base = "liquid-ofc"
runs = 2
[set]
duration_s = 16.0
"detectors.enabled" = ["iotsekf", "rfafe", "ofc_monitor"]
[grid]
"faults.0.amplitude_mm" = [1.0, 8.0]
[draw]
"faults.0.frequency_hz" = { low = 0.5, high = 5.0, scale = "log" }
"""

if __name__ == "__main__":  # workers are processes of their own, which read this file
    Path("amplitudes.toml").write_text(CAMPAIGN)
    done = run_campaign("amplitudes.toml", out="amplitudes", resume=Path("amplitudes").exists())
    rows = done.frame  # a row per run and detector lane; the same as amplitudes/runs.parquet
    mine = rows[rows["concerned"].astype(bool)]
    seen = mine.assign(seen=mine["delay_s"].notna())
    print(seen.pivot_table(index="id", columns="faults.0.amplitude_mm", values="seen", aggfunc="mean"))
    print(f"{cosim.__version__}: rows in {done.parquet}")
