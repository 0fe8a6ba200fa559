"""Designs made at run time take BLAS kernels by processor: flights differ in last bits, logs replay exactly."""

import os
import subprocess
import sys

import numpy as np
import pytest

import cosim
from cosim.log import open_log
from cosim.replay import replay

KEYS = ["duration_s=1", "faults.0.start_s=0.5"]
FLY = f"import cosim, sys; cosim.simulate(cosim.load_scenario('liquid-ofc', {KEYS}), log=sys.argv[1], timed=False)"


@pytest.mark.skipif(os.uname().machine != "x86_64", reason="names kernels of x86-64")
def test_a_log_of_another_processor_replays_exactly(tmp_path):
    env = os.environ | {"OPENBLAS_CORETYPE": "Prescott"}  # kernels without the vectors of later processors
    subprocess.run([sys.executable, "-c", FLY, tmp_path / "there.mcap"], env=env, check=True)
    told = replay(tmp_path / "there.mcap")
    assert told.exact and told.values > 10_000
    cosim.simulate(cosim.load_scenario("liquid-ofc", KEYS), log=tmp_path / "here.mcap", timed=False)
    there, here = (open_log(tmp_path / f"{name}.mcap").array("/truth/aircraft") for name in ("there", "here"))
    np.testing.assert_allclose(there, here, rtol=1e-6, atol=1e-6)
