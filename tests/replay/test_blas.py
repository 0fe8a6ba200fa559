"""A flight has the same bytes whatever kernels BLAS picks for the processor; so has its replay."""

import os
import subprocess
import sys

import pytest

import cosim
from cosim.log import open_log
from cosim.replay import replay

KEYS = ["duration_s=1", "faults.0.start_s=0.5", "flight.mass_t=251.3", "flight.mach=0.61", "flight.altitude_ft=14200"]
FLY = f"import cosim, sys; cosim.simulate(cosim.load_scenario('liquid-ofc', {KEYS}), log=sys.argv[1], timed=False)"


@pytest.mark.skipif(os.uname().machine != "x86_64", reason="names kernels of x86-64")
def test_a_flight_has_the_same_bytes_on_another_processor(tmp_path):
    env = os.environ | {"OPENBLAS_CORETYPE": "Prescott"}  # kernels without the vectors of later processors
    subprocess.run([sys.executable, "-c", FLY, tmp_path / "there.mcap"], env=env, check=True)
    cosim.simulate(cosim.load_scenario("liquid-ofc", KEYS), log=tmp_path / "here.mcap", timed=False)
    there, here = (open_log(tmp_path / f"{name}.mcap").array("/truth/aircraft") for name in ("there", "here"))
    assert len(there) >= 200 and there.tobytes() == here.tobytes()
    told = replay(tmp_path / "there.mcap")
    assert told.exact and told.values > 10_000
