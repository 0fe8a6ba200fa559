"""Trial load of a user's aircraft model in a process of its own: JSBSim may abort on one that is wrong."""

import re
import subprocess
from pathlib import Path

from actuators.kernels import python
from cosim.scenario.aircraft import of_folder

_ALONE = """
import sys
import jsbsim
fdm = jsbsim.FGFDMExec(None)
fdm.set_aircraft_path(sys.argv[1])
loaded = fdm.load_model(sys.argv[2])
sys.exit(0 if loaded and fdm.run_ic() else 1)
"""


@of_folder
def fatal(folder: Path, name: str) -> str:
    """Return what JSBSim says about the model `name` of a folder that it cannot load, or ""."""
    call = python(_ALONE, str(folder.parent), name)
    try:
        done = subprocess.run(**call, capture_output=True, text=True, errors="replace", timeout=60.0)
    except subprocess.TimeoutExpired:
        return "cannot be loaded: JSBSim takes longer than a minute"
    if done.returncode == 0:
        return ""
    said = [line.strip() for line in re.sub(r"\x1b\[[0-9;]*m", "", done.stderr + done.stdout).splitlines()]
    telling = re.compile(r"error|not found|could not|undefined|does not exist|what\(\)", re.IGNORECASE)
    reason = [re.sub(r"^_jsbsim\.\w+:\s*", "", line) for line in said if telling.search(line)]
    return "cannot be loaded: " + ("; ".join([*dict.fromkeys(reason)][:3]) or f"JSBSim ended with {done.returncode}")
