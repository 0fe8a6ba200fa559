"""What a flight compiles is known before it flies."""

from cosim.flight.loop import compiling
from cosim.flight.simulate import simulate
from cosim.scenario import load_scenario


def test_nothing_is_left_to_compile_after_a_flight():
    scenario = load_scenario("cruise", ["duration_s=0.1"])
    simulate(scenario, timed=False)
    names = compiling.functions(scenario)
    assert {"fdi.hydraulic.iotsekf", "cosim.flight.blocks.law", "cosim.flight.loop.tape"} <= set(names)
    assert compiling.prepare(scenario, lambda i, n: None) == 0
