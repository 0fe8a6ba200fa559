"""Many flights: draws, one pool of workers, a folder of rows; `cosim.campaign.flights` flies them.

    from cosim.campaign import run_many

Nothing is imported before it is asked for: a worker imports this package, and needs no pandas.
"""

import importlib
from typing import Any

OF_FLIGHTS = ("CampaignError", "CampaignResult", "EVALUATION_SEED", "run_many", "table")


def __getattr__(name: str) -> Any:
    """Return a name of `cosim.campaign.flights`."""
    if name not in OF_FLIGHTS:
        raise AttributeError(f"module 'cosim.campaign' has no attribute {name!r}")
    return getattr(importlib.import_module("cosim.campaign.flights"), name)
