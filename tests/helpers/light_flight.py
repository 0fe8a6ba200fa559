"""A stand-in for a flight, for tests of what carries flights: rows that follow from the scenario alone, in a moment."""

import time

from cosim.scenario import Scenario

PAUSE_S = 2.0


def ready(i: int) -> int:
    """Return `i` after a moment, so that every worker gets some."""
    time.sleep(0.3)
    return i


def fly(run: str, scenario: Scenario, achieved: bool) -> tuple[list[dict], list[dict]]:
    """Return rows and timing as cosim.campaign.worker.fly does."""
    time.sleep(PAUSE_S)
    about = {"run": run, "status": "completed", "error": "", "sim_time_s": scenario.duration_s, "level": "local"}
    rows = [{**about, "lane": i, "id": "light", "target": f"elevator.{i}", "false_alarms": (scenario.seed + i) % 3,
             "r_max_before": ((scenario.seed * 7919 + i) % 1000) / 1000.0} for i in range(4)]  # fmt: skip
    return rows, [{"run": run, "wall_time_s": PAUSE_S, "startup_s": 0.0}]
