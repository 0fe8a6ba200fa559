"""What a flight compiles is known before it flies."""

from cosim.flight import compiling
from cosim.flight.simulate import simulate
from cosim.scenario import load_scenario


class Cold:
    """Stand for a compiled function that is not there yet."""

    def ready(self):
        return False


def test_nothing_is_left_to_compile_after_a_flight():
    scenario = load_scenario("cruise", ["duration_s=0.1"])
    simulate(scenario, timed=False)
    names = compiling.functions(scenario)
    assert {"fdi.hydraulic.iotsekf", "cosim.flight.blocks.law", "cosim.flight.tape"} <= set(names)
    assert compiling.prepare(scenario, lambda i, n: None) == 0


def test_what_is_missing_is_counted(monkeypatch):
    compiled, told = [], []
    monkeypatch.setattr(compiling, "PLAIN", False)
    monkeypatch.setattr(compiling, "functions", lambda scenario: {"a": Cold(), "b": Cold()})
    monkeypatch.setattr(compiling, "_compile", compiled.append)
    assert compiling.prepare(None, lambda i, n: told.append((i, n))) == 2
    assert compiled == ["a", "b"] and told == [(1, 2), (2, 2)]
