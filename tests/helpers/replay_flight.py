"""A short flight with every detector and a fault, for the tests of replay."""

import cosim

CHANGES = ("duration_s=6", "faults.0.start_s=3", "manoeuvre.kind=nz_doublet", "manoeuvre.start_s=1")


def fly(path):
    """Fly it, log to `path` and return that."""
    cosim.simulate(cosim.load_scenario("liquid-ofc", CHANGES), log=path, timed=False)
    return path
