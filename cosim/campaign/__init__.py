"""Many flights: draws, one pool of workers, a folder of rows; `cosim.campaign.flights` flies them.

    from cosim.campaign import run_many

Nothing is imported before it is asked for: a worker imports this package, and needs no pandas.
"""

import importlib
from typing import Any

MODULES = dict.fromkeys(("CampaignError", "CampaignResult", "run_many", "table"), "engine")
MODULES["EVALUATION_SEED"] = "spec"


def __getattr__(name: str) -> Any:
    """Return a name of one of the MODULES."""
    if name not in MODULES:
        raise AttributeError(f"module 'cosim.campaign' has no attribute {name!r}")
    return getattr(importlib.import_module(f"cosim.campaign.{MODULES[name]}"), name)
