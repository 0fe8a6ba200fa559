"""What tests send to workers: a process that is asked for it imports this file, not a whole test with its libraries."""

import os
import signal

from cosim.campaign.worker import Flown, failed
from cosim.scenario import load_scenario

FEW = '["iotsekf", "position_monitor"]'


def flights(n, *more):
    """Return n short flights with an oscillation, each with its own seed."""
    keys = ("duration_s=3", "faults.0.start_s=1", "faults.0.frequency_hz=3", f"detectors.enabled={FEW}", *more)
    return [load_scenario("liquid-ofc", [*keys, f"seed={1_000_000 + i}"]) for i in range(n)]


def die(group, signals, kill=os.kill):
    """Fly nothing of `group`, [(run, path of a marker)]; "deadly" kills its process, "unlucky" the first."""
    flown = []
    for run, marker in group:
        if run == "deadly" or (run == "unlucky" and not os.path.exists(marker)):
            open(marker, "w").close()
            kill(os.getpid(), signal.SIGKILL)
        flown.append(Flown(run, [failed(run, "completed", "")], []))
    return flown
