"""Likelihood ratios of the faults of one hydraulic actuator, on the innovations of a filter without a fault state.

What may be wrong with actuator and sensors is a hypothesis with a signature in the innovations (`filter`, `response`);
its evidence against health is taken over windows of seven lengths (`sums`, `evidence`). Errors within tolerances are
part of every hypothesis, learned in flight while nothing is wrong. An alarm is evidence beyond a threshold, a name the
class that leads (`decide`). Rod and surface that disagree, which a filter with both only sees as a difference, are
told apart by the model's slow position (fdi/common/decision.py). Sources: [Willsky76] A. Willsky, H. Jones, A
generalized likelihood ratio approach to the detection and estimation of jumps in linear systems, IEEE Trans. Automatic
Control 21 (1976); [Basseville93] M. Basseville, I. Nikiforov, Detection of Abrupt Changes, Prentice Hall (1993).

| hypothesis | model | name |
|---|---|---|
| ADDED, IN_PLACE | oscillation of the valve, beside the command, or with nothing left of it | OFC_LIQUID, OFC_SOLID |
| OPEN, SLOW | constant flow, flow that grows, nothing left of the command | RUNAWAY where it stays, else AMBIGUOUS |
| LOSS, LEAKAGE, LOW_SUPPLY, SOFT_OIL, FREE | columns of the filter, far from their tolerance | EFFECTIVENESS |
| SWING_LOAD, RUBS | oscillation of the load, friction | JAM_SOLID while the rod is still, else EFFECTIVENESS |
| SWING_x, NOISE_x, OFF_PRESSURE | oscillation, noise, error of a sensor | SENSOR |

The pressure's and a position's last value that repeats is a frozen sensor.
"""

from typing import Any

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.common import linkage
from actuators.disk_cache import kept
from actuators.hydraulic import lu17
from actuators.hydraulic.lu17 import opening, stiffness
from fdi.common import decision
from fdi.common.decision import usable
from fdi.common.record import Detector, Site
from fdi.common.tuning import thresholds
from fdi.isolation import decide, evidence, filter, sums
from fdi.isolation.filter import SENSORS
from fdi.isolation.response import PLACES, responses

CULPRITS = ("", "rod", "surface", "pressure")
PERIOD = 0.005  # of the samples whose variance stands in `filter.NOISE` [s]
BEGIN_S, LEARN_S = 1.0, 4.0  # the filter settles; what is learned then starts the windows [s]
STOP = 1e-3  # so near a stop the rod may lean on it [m]
DT_MOST = 0.0101  # of longer ticks a filter that is linear over a tick leaves too much: never valid there [s]
YOUNG = 1.0 / 3.0  # of its length, from which on a window is asked
LOST_S = 0.2  # without positions, or without pressure, for longer it is not valid [s]
QUIET_S = 1.0  # after the last sign of a fault the flight teaches again [s]
STILL_HZ = 0.02  # slow enough for a constant
# Least threshold. Evidence of k to one against health comes by chance with a probability of 1 / k at most; in 60 s a
# hypothesis is asked over 480 windows: 1e-3 per flight asks for k = 4.8e5
LEAST = 13.1

PARAMS = dtype(
    [
        *filter.PARAMS,
        *sums.PARAMS,
        ("response", "f8", (len(PLACES), sums.OCTAVES, sums.LINES, 2 * SENSORS)),  # real and imaginary parts
        ("still", "f8", (len(PLACES), SENSORS)),  # responses to a constant
        *evidence.PARAMS,
        *decision.PAIR_PARAMS,
        ("limit", "f8", (evidence.HYPOTHESES,), "-"),  # evidence that is an alarm
        ("q_lo", "f8", "m"),  # stops of the rod
        ("q_hi", "f8", "m"),
    ]
)
INPUTS = dtype(
    [
        ("u", "f8", "-"),  # valve command held over the last tick, as the servo sent it
        ("y_rod", "f8", "m"),
        ("y_rod_valid", "f8", "-"),
        ("y_surface", "f8", "rad"),
        ("y_surface_valid", "f8", "-"),
        ("y_dp", "f8", "-"),  # pressure difference over supply
        ("y_dp_valid", "f8", "-"),
        ("hm0_model", "f8", "N m"),  # hinge moment at zero deflection, by the model
        ("hmd_model", "f8", "N m/rad"),  # its slope
    ]
)
STATE = dtype(
    [
        *filter.STATE,
        *sums.STATE,
        *evidence.STATE,
        *decision.PAIR_STATE,
        *decide.STATE,
        ("since", "f8", "s"),  # something last spoke for a fault
        ("r", "f8", "-"),  # largest evidence over its threshold
        ("alarm", "f8", "-"),
        ("verdict", "f8", "-"),
        ("culprit", "f8", "-"),
        ("valid", "f8", "-"),
    ]
)
OUTPUTS = ("r", "alarm", "verdict", "culprit", "valid", "ofc_hz", "ofc_amplitude")
_WEAK = ("effectiveness", "ambiguous")
DETECTOR = Detector(
    id="hydraulic_glr",
    level="local",
    summary="likelihood ratios of faults of a hydraulic actuator [Willsky76]",
    technologies=("hydraulic",),
    inputs={
        "u": "valve_command", "y_rod": "rod", "y_surface": "surface", "y_dp": "pressure", "hm0_model": "hm0",
        "hmd_model": "hmd",
    },
    group="actuator filters",
    designed_for={
        "hydraulic.ofc_liquid": ("ofc_liquid",),
        "hydraulic.ofc_solid": ("ofc_solid",),
        "hydraulic.jam_solid": ("jam_solid",),
        "hydraulic.runaway": ("runaway",),
        **dict.fromkeys((
            "hydraulic.loss_of_effectiveness", "hydraulic.supply_pressure_drop", "hydraulic.internal_leakage",
        ), ("effectiveness",)),
        **dict.fromkeys((
            "hydraulic.jam_liquid", "hydraulic.rod", "hydraulic.surface", "hydraulic.pressure",
            "hydraulic.ofc_liquid@sensor",
        ), ("sensor",)),
    },
    may_see={
        **dict.fromkeys(("hydraulic.air_in_oil", "hydraulic.free_float"), _WEAK),
        "hydraulic.friction": ("jam_solid", *_WEAK),
        "hydraulic.backlash": ("sensor", *_WEAK),
    },
    blind="compares one hydraulic rod with its own valve command: a fault before the valve command moves both alike",
    looks_back={"delay": "u_old"},
    sizes={"block": 1},
    fit=lambda site: fitted(site),
)  # fmt: skip


def params(
    which: str = "flight", *, dt: Any = 0.005, delay_s: float = 0.005, arm: float = linkage.ARM, own: Any = None,
    travel: tuple[float, float] = linkage.TRAVEL, **values: Any,
) -> np.ndarray:  # fmt: skip
    """Return PARAMS for ticks of `dt` seconds and measurements `delay_s` old, with threshold set `which`.

    The sensors' noise density is that of samples of 5 ms at every rate. `travel` are the stops [rad]; `own` is the
    folder of an aircraft with thresholds of its own; `values` replace fields.
    """
    pair = thresholds("iotsekf", "flight_load2")
    v = {
        **lu17.NOMINAL, **filter.NOISE, **sums.design(dt), **filter.high_pass(dt), **evidence.PRIORS,
        **{name: pair[name] for name, *_ in decision.PAIR_PARAMS}, **thresholds("hydraulic_glr", which, own),
        "arm": arm, "delay": float(round(delay_s / dt)), "q_lo": arm * travel[0], "q_hi": arm * travel[1],
    }  # fmt: skip
    v["r"] = np.asarray(v["r"]) * PERIOD / dt
    p = record(PARAMS, **{**v, **values})
    p["limit"] = np.maximum(p["limit"], LEAST)
    hz = p["hz"][0].ravel()
    given = [p[0][name].tolist() for name in ("arm", "q", "r", "P0", *lu17.NOMINAL)]
    shape = (len(PLACES), 1 + len(hz), 2 * SENSORS)
    H = kept((given, dt, hz.tolist()), float, lambda: _responses(p[0], dt, hz), __file__).reshape(shape)
    p["still"][0] = H[:, 0, 0::2]
    p["response"][0] = H[:, 1:].reshape(len(PLACES), sums.OCTAVES, sums.LINES, 2 * SENSORS)
    return p


def _responses(p, dt, hz):
    H = responses(p, dt, np.concatenate([[STILL_HZ], hz]))
    H[:, 1:] *= np.sinc(hz * p["block"] * dt)[None, :, None]  # of the sum over a block
    return np.stack([H.real, H.imag], axis=-1).ravel()


def fitted(site: Site, **values: Any) -> np.ndarray:
    """Return PARAMS for a loop."""
    given: dict[str, Any] = {"travel": site.travel} if site.travel else {}
    given |= site.known(("arm", *lu17.NOMINAL))
    return params(dt=site.dt, own=site.own, **given, **values)


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape: nothing learned, the filter begins at the first usable rod sample."""
    x = np.zeros(p.shape, STATE)
    x["mu"], x["sd"], x["noise"], x["phase_c"] = p["prior_mean"], p["prior_sd"], 1.0, 1.0
    x["ev_octave"] = -1.0
    return x


@kernel
def restart(x):
    """Let every window begin anew."""
    sums.empty_all(x)
    sums.clear_block(x)
    decide.forget(x)


@kernel
def close(x, p, dt):
    """Take a finished block: evidence of one octave, decision, lesson."""
    sums.close_block(x, p)
    o = sums.octave(x.blocks)
    anew = False
    if x.age[o] >= YOUNG * p.length[o] and x.clock >= LEARN_S:
        evidence.evaluate(x, p, o)
        anew = decide.judge(x, p, o, dt)
    if (x.since > QUIET_S and x.alarm < 0.5) or x.clock < LEARN_S:
        evidence.teach(x, p, dt)
    sums.clear_block(x)
    if int(x.blocks) % int(sums.SOLVE_BLOCKS) == 0:
        evidence.solve(x, p)
        anew = anew or x.clock < LEARN_S
    if anew:
        restart(x)


@kernel
def step(x, u, p, dt):
    """Run the filter, add up, ask, decide."""
    x.ev_octave = -1.0
    if dt > DT_MOST:
        return
    if not filter.advance(x, u, x.mu, x.since > QUIET_S and x.alarm < 0.5, p, dt):
        x.valid = 0.0
        return
    rod, surface = usable(u.y_rod, u.y_rod_valid), usable(u.y_surface, u.y_surface_valid)
    bulk = x.x_hat[2] / stiffness(x.x_hat[0], p)  # rod motion that only compresses oil
    v = x.u_old[int(p.delay)]
    flow = (1.0 + x.mu[filter.GAIN]) * p.phi_n / p.A_p * opening(v, x.x_hat[2]) * v - p.L * x.x_hat[2]
    y_surface = p.arm * u.y_surface + bulk
    decision.pair_test(x, u.y_rod + bulk, rod, y_surface, surface, flow, x.x_hat[3], p, dt)
    freeze = decide.frozen(x, u, dt)
    x.valid = 1.0 if x.clock >= LEARN_S and max(x.lost, x.lost_pressure) <= LOST_S else 0.0
    if x.clock < BEGIN_S:
        return
    x.since += dt
    x.timer = max(x.timer - dt, 0.0)
    stop = x.x_hat[0] < p.q_lo + STOP or x.x_hat[0] > p.q_hi - STOP
    if stop or x.at_stop > 0.5 or max(x.lost, x.lost_pressure) > LOST_S:  # the model ends there
        x.at_stop = 1.0 if stop else 0.0
        restart(x)
    else:
        sums.add_tick(x)
        if x.tick >= p.block:
            close(x, p, dt)
    decide.conclude(x, u, p, freeze, dt)


rollout = entry(step, STATE, INPUTS, PARAMS)
