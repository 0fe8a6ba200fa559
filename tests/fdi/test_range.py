"""Valid means valid: what is not finite, or out of a detector's range, is never valid. Words for it are unique."""

import numpy as np
import pytest

import cosim
from actuators.block import dtype, entry, kernel, record
from cosim.campaign.inventory import inventory
from cosim.log import open_log
from cosim.replay.detector_replay import describe, topics
from fdi import registry
from fdi.common import why
from fdi.kinematic import kinematic

PARAMS = dtype([("growth", "f8")])
INPUTS = dtype([("y", "f8")])
SAYS = [(n, "f8") for n in ("r", "alarm", "verdict", "isolated_part", "valid", "why")]
STATE = dtype([("hidden", "f8", (3,)), *SAYS])
DT = 0.005


@kernel
def step(x, u, p, dt):
    """Overflow in a hidden state; where it has, a comparison makes the statistic zero, as it would in a detector."""
    x.hidden[1] = (x.hidden[1] + u.y) * p.growth
    x.r = x.hidden[1] if x.hidden[1] - x.hidden[1] == 0.0 else 0.0
    x.alarm, x.verdict, x.isolated_part, x.valid, x.why = 1.0, 2.0, 1.0, 1.0, 0.0


rollout = entry(step, STATE, INPUTS, PARAMS)


def test_a_state_that_is_not_finite_is_never_valid_and_never_alarms():
    x, p, u = np.zeros(1, STATE), record(PARAMS, growth=1e30), np.ones((1, 20), INPUTS)
    log = np.zeros((1, 20), STATE)
    rollout(x, u, p, DT, log)
    ok = np.isfinite(log["hidden"][0]).all(axis=1)
    assert 5 < ok.sum() < 20
    assert (log["valid"][0] == ok).all() and (log["alarm"][0] == ok).all() and (log["verdict"][0] == 2.0 * ok).all()
    assert (log["why"][0][~ok] == why.NOT_FINITE).all()
    live = np.zeros(1, STATE)
    for k in range(20):  # one tick at a time, as in flight
        rollout(live, u[:, k : k + 1], p, DT)
        assert live.tobytes() == log[0, k].tobytes()


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """Return {detector: (Lane, its INPUTS (1, ticks))} of a healthy flight of 16 s."""
    path = tmp_path_factory.mktemp("range") / "healthy.mcap"
    changes = ["duration_s=16", "faults=[]", f"detectors.enabled={list(registry.SHIPPED)}"]
    cosim.simulate(cosim.load_scenario("liquid-ofc", changes), log=path, timed=False)
    log = open_log(path)
    lanes = {lane.id: lane for lane in describe(log)}
    read = {name: log.array(name) for name in topics(log, lanes.values())}
    return {name: (lane, lane.inputs(log, read, 0, log.n_ticks)[1]) for name, lane in lanes.items()}


RANGES = [(name, word, end) for name, r in registry.records().items() for word in r.range for end in (0, 1)]


@pytest.mark.parametrize(("name", "word", "end"), RANGES)
def test_outside_of_a_bound_it_is_not_valid_and_says_of_what(flown, name, word, end):
    own, module, (lane, u) = registry.record(name), registry.module(name), flown[name]
    low, high = own.range[word]
    field = next(f for f, w in own.inputs.items() if w == word)
    u, p, log = u.copy(), lane.p.copy(), np.zeros(u.shape, module.STATE)
    if name == "lpv_smo":
        p["tau_rho"] = 0.0  # its parameters lag behind
    fields = kinematic.SPEEDS if name == "kinematic" else (field,)  # which takes the word of two of its three speeds
    for one in fields:
        u[one][:, 2800:] = high + 0.02 * abs(high) if end else low - 0.02 * abs(low)
    module.rollout(lane.x.copy(), u, p, DT, log)
    assert log["valid"][0][2700:2800].all() and not log["valid"][0][3000:].any()
    assert why.WORDS[int(log["why"][0][-1])].startswith("outside its box")


AIRFRAME = [name for name, r in registry.records().items() if r.level == "aircraft" and r.range]
AT_REST = ("tas", "cas", "mach", "v_ground", "p", "q", "r", "pdot", "qdot", "rdot", "hdot", "phi", "theta", "beta",
           "alpha", "alpha_ground", "n_x", "n_y")  # fmt: skip


def on_the_apron(name, u, n):
    """Return INPUTS (1, n + ticks): n ticks of an aircraft that stands, commands and all at zero, then those of u."""
    own, rest, rng = registry.record(name), np.repeat(u[:, :1], n, axis=1).copy(), np.random.default_rng(5)
    for field, word in own.inputs.items():
        base, _, element = field.partition("[")
        y = rest[base][0][:, int(element[:-1])] if element else rest[base][0]
        if word in AT_REST or word.endswith("_cmd"):
            y[:] = 0.0 if word.endswith("_cmd") else 1e-3 * rng.standard_normal(n)
        elif word == "n_z":
            y[:] = 1.0
        elif word.startswith("n1_"):
            y[:] = 25.0
    return np.concatenate([rest, u], axis=1)


@pytest.mark.parametrize("name", AIRFRAME)
def test_what_is_learned_is_learned_in_range_and_the_apron_leaves_no_trace(flown, name):
    module, (lane, u), n = registry.module(name), flown[name], 4000
    both, alone = on_the_apron(name, u, n), np.zeros(u.shape, module.STATE)
    log = np.zeros(both.shape, module.STATE)
    module.rollout(module.init(lane.p), both, lane.p.copy(), DT, log)
    module.rollout(module.init(lane.p), u, lane.p.copy(), DT, alone)
    assert not log["valid"][0][:n].any() and not log["alarm"].any() and not (log["why"] == why.NOT_FINITE).any()
    assert alone["valid"][0][-1] == 1.0
    assert log["valid"][0][n:].sum() == pytest.approx(alone["valid"][0].sum(), abs=20)
    assert log["r"][0][-1] == pytest.approx(alone["r"][0][-1], rel=0.05, abs=0.02)


def test_the_range_of_each_detector_is_listed_and_names_inputs_with_a_width():
    listed = {d["id"]: d["range"] for d in inventory()["detectors"]}
    for name, own in registry.records().items():
        assert bool(listed[name]) == bool(own.range)
        for word, (least, largest) in own.range.items():
            assert word in listed[name] and word in own.inputs.values() and least < largest


def test_reasons_have_words_and_nothing_else_has():
    codes = [v for k, v in vars(why).items() if isinstance(v, float)]
    assert sorted(codes) == list(range(len(why.WORDS)))
    assert why.words(why.BOX_MASS) == "outside its box (mass)"
    for wrong in (-1.0, 0.5, float(len(why.WORDS))):
        with pytest.raises(ValueError, match="no reason"):
            why.words(wrong)


@pytest.mark.parametrize("name", registry.SHIPPED)
def test_every_value_of_a_state_has_a_name_of_its_own_in_a_log(name):
    kind, names = registry.module(name).STATE, []
    for field in kind.names:
        n = kind[field].itemsize // 8
        names += [field] if n == 1 and not kind[field].shape else [f"{field}_{i}" for i in range(n)]
    assert len(set(names)) == len(names)
