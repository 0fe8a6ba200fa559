"""The kernels as plain Python give the bits of the compiled ones: the first 1,000 ticks, and 200 around the alarm."""

import json
import os
import subprocess
import sys

import pytest

import cosim

# replays one lane of each detector, one that alarmed if any, and prints {id: [values, differences] of both stretches}
SCRIPT = """
import json, sys
import numpy as np
from numba.core import config
from cosim.log import open_log
from cosim.replay import compare
from cosim.replay.detector_replay import describe, fill, pieces, replay_lane
assert config.DISABLE_JIT
log, told = open_log(sys.argv[1]), {}
first, around = int(sys.argv[2]), int(sys.argv[3])

def alarm(w):
    return np.flatnonzero(log.frame(w.topic)["alarm"].to_numpy() > 0.5)

for w in sorted(describe(log), key=lambda w: not len(alarm(w))):
    if w.id in told:
        continue
    middle = int(alarm(w)[0]) if len(alarm(w)) else 600
    told[w.id] = []
    for start, stop, tick in ((0, first, 0), (0, middle + around, max(0, middle - around))):
        (lane,) = fill(log, [w], start, stop)
        (piece,) = pieces(lane, tick)
        out, _, _ = replay_lane(piece, log.dt_ns * 1e-9)
        told[w.id] += [int(out.size), len(compare(w.topic, log.topics[w.topic].fields, piece.ticks, piece.logged,
        out))]
print(json.dumps(told))
"""


@pytest.mark.slow
def test_plain_python_gives_the_same_bits_for_1000_ticks_and_200_around_the_alarm(short_log):
    """Every block on signals by hand is in tests/flight/test_blocks.py; here on those of a flight."""
    first, around = 1000, 100
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    args = [sys.executable, "-c", SCRIPT, str(short_log), str(first), str(around)]
    done = subprocess.run(args, capture_output=True, text=True, env=plain)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert set(told) == set(cosim.load_scenario("liquid-ofc").running)
    for name, (values, wrong, values_around, wrong_around) in told.items():
        assert values >= first * 5 and values_around >= 2 * around * 5, name
        assert (wrong, wrong_around) == (0, 0), name
