"""What tests send to workers: a process that is asked for it imports this file, not a whole test with its libraries."""

import os
import signal

from cosim.scenario import load_scenario

FEW = '["iotsekf", "position_monitor"]'


def flights(n, *more):
    """Return n short flights with an oscillation, each with its own seed."""
    keys = ("duration_s=3", "faults.0.start_s=1", "faults.0.frequency_hz=3", f"detectors.enabled={FEW}", *more)
    return [load_scenario("liquid-ofc", [*keys, f"seed={1_000_000 + i}"]) for i in range(n)]


def square(x):
    """Return x squared, and which process found it."""
    return {"pid": os.getpid(), "value": x * x}


def deadly(run, scenario, achieved):
    """Fly nothing; the run "deadly" ends its process, as a campaign's `fly` otherwise."""
    if run == "deadly":
        os._exit(9)
    return [{"run": run, "lane": 0, "status": "completed"}], []


def killed(run, scenario, achieved):
    """The same; the system kills the process."""
    if run == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    return [{"run": run, "lane": 0, "status": "completed"}], []


def die_once(run, scenario, achieved):
    """The same; the first process that flies "deadly" is killed, after it has left COSIM_TEST_MARKER."""
    marker = os.environ["COSIM_TEST_MARKER"]
    if run == "deadly" and not os.path.exists(marker):
        open(marker, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return [{"run": run, "lane": 0, "status": "completed"}], []
