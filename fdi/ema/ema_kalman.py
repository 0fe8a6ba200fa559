"""Sensor faults of an electromechanical actuator: one Kalman filter on the motor velocity, as published. [Jay]

| symbol | field | meaning |
|---|---|---|
| Phi, G, H | Phi, G, K_v | discrete model; H has the one entry K_v at the motor rate |
| R | R | velocity noise in the sensor's volts [V^2] |
| gamma, eta | gamma, eta | innovation [V], normalised by (H P H' + R)^(1/2) (6) |
| eta_bar | eta_bar | mean of the last N = 10 (7) |
| R1, R2 | R1, R2 | structured residuals of position [m] and current [A] (9) |

The process noise is zero, so that after half a second the gain has vanished and this is the open-loop model: sharp on a
bench without load, unable to fly against a hinge moment. `ema_kalman_flight` is the form that flies.

The test is hierarchical: R1 and R2 count only while the innovation says that the velocity sensor is healthy
(section 3). A position fault latches `reconf`: the loop should close on `pos_hat` from then on (section 4.5).
"""

import math

import numpy as np

from actuators.block import dtype, entry, kernel, record
from actuators.ema import jay
from fdi.common.decision import usable
from fdi.common.record import Detector
from fdi.common.verdict import NONE, SENSOR

ISOLABLE_PARTS = ("", "velocity", "position", "current")
VELOCITY, POSITION, CURRENT = 1.0, 2.0, 3.0
N = 10  # samples of the innovation mean; [Jay] section 4.1

PARAMS = dtype([
    ("Phi", "f8", (6, 6)),   # state transition over one tick, SI
    ("G", "f8", (6,)),       # of the demand u
    ("P0", "f8", (6,)),      # diagonal of the initial covariance
    ("R", "f8", "V2"),
    ("K_v", "f8", "V s/rad"),  # velocity sensor
    ("lead", "f8", "m/rad"),  # ball screw N
    ("ratio", "f8", "-"),    # N / l, surface per motor angle with the spring at rest
    ("delay", "f8", "-"),         # ticks by which the sensors lag, 0 or 1
    ("engage", "f8", "-"),        # 1: start at the measured position, 0: at zero as printed
    ("th_eta", "f8", "-"),   # threshold of |eta_bar|
    ("th_R1", "f8", "m"),
    ("th_R2", "f8", "A"),
])
INPUTS = dtype([
    ("u", "f8", "V, A"),             # demand held over the tick that ends at this sample: nozzle [V], elevator [A]
    ("y_velocity", "f8", "rad/s"),  # motor rate
    ("y_position", "f8", "m"),  # rod position, + extends
    ("y_current", "f8", "A"),  # motor current, the monitor's copy
    ("velocity_valid", "f8", "-"),
    ("position_valid", "f8", "-"),
    ("current_valid", "f8", "-"),
])
STATE = dtype([
    ("r", "f8", "-"),        # largest of the tests that count, over its threshold
    ("alarm", "f8", "-"),    # 1 while a sensor fault is declared
    ("verdict", "f8", "-"),  # NONE or SENSOR
    ("isolated_part", "f8", "-"),  # index into ISOLABLE_PARTS
    ("valid", "f8", "-"),    # 1 while the velocity sensor is believed
    ("reconf", "f8", "-"),        # 1: close the loop on pos_hat
    ("pos_hat", "f8", "m"),  # estimated rod position N x3
    ("pos_sigma", "f8", "m"),  # its standard deviation by the filter's own reckoning
    ("eta", "f8", "-"),           # (6)
    ("eta_bar", "f8", "-"),       # (7)
    ("R1", "f8", "m"),       # (9)
    ("R2", "f8", "A"),       # (9)
    ("x_hat", "f8", (6,), "rad, rad/s, rad, rad/s, A, -"),  # x1..x6 of actuators.ema.jay
    ("u_last", "f8", "V, A"),        # demand of the tick before
    ("started", "f8", "-"),       # 1 after the first tick
    ("head", "f8", "-"),          # write position in the window
    ("window", "f8", (N,), "-"),  # last N values of eta
    ("P", "f8", (6, 6)),     # covariance
    ("W", "f8", (6, 6)),     # scratch of the covariance propagation
])
OUTPUTS = ("r", "alarm", "verdict", "isolated_part", "valid", "reconf", "pos_hat", "pos_sigma", "eta", "eta_bar", "R1",
           "R2")  # fmt: skip
DETECTOR = Detector(
    id="ema_kalman",
    level="local",
    summary="one Kalman filter on motor speed as published, structured residuals [Jay]",
    technologies=("ema",),
    inputs={"u": "current_command", "y_velocity": "velocity", "y_position": "position", "y_current": "current"},
    group="actuator filters",
    designed_for={  # [Jay]: three sensors, structured residuals
        **dict.fromkeys(("ema.velocity", "ema.position", "ema.jam_liquid", "ema.current"), ("sensor",)),
    },
    may_see={  # whatever the load-free model lacks ends in its residuals; it knows only the class SENSOR
        **dict.fromkeys((
            "ema.ofc_liquid", "ema.ofc_solid", "ema.jam*", "ema.free_float", "ema.loss_of_effectiveness",
            "ema.magnet_loss", "ema.winding_resistance", "ema.friction", "ema.backlash",
        ), ()),
    },
    blind="compares the sensors of one electromechanical drive with the model of its own demand",
    places={"head": ("window", 0)},
    fit=lambda site: params("elevator", dt=site.dt, **site.actuator),
)


def params(
    kind: str = "nozzle",
    *,
    dt: float = jay.PERIOD,
    R: float = 0.0025,
    engage: bool | None = None,
    delay: float | None = None,
    **overrides: float,
) -> np.ndarray:
    """Return PARAMS of the exactly discretised model `kind` with the paper's covariances and thresholds.

    R = 0.0025 V^2, P0 = diag(0.0003 x 4, 0.01, 0.01), 3 / 0.5 mm / 0.5 A: [Jay] sections 3.3, 4 and 4.1. `engage`
    (start at the measured position) and `delay` (of the sensors, in ticks) default to 0 for the nozzle, as printed, and
    to 1 for the elevator, whose trim position is not zero. `overrides` are symbols of `actuators.ema.jay.values`.
    """
    model = jay.continuous(kind, **overrides)
    Phi, G = jay.discretise(model.A, model.B, dt)
    return record(
        PARAMS,
        Phi=Phi,
        G=G[:, 0],
        P0=(3e-4, 3e-4, 3e-4, 3e-4, 1e-2, 1e-2),
        R=R,
        K_v=jay.K_V,
        lead=model.values["lead"],
        ratio=model.values["lead"] / model.values["arm"],
        delay=float(kind != "nozzle") if delay is None else float(delay),
        engage=float(kind != "nozzle") if engage is None else float(engage),
        th_eta=3.0,
        th_R1=0.5e-3,
        th_R2=0.5,
    )


def init(p: np.ndarray) -> np.ndarray:
    """Return STATE of p's shape: x_hat = 0 and P0, as printed."""
    x = np.zeros(p.shape, STATE)
    x["P"] = p["P0"][..., None] * np.eye(6)
    x["valid"] = 1.0
    return x


@kernel
def propagate(P, Phi, W):
    """Replace P by Phi P Phi', symmetric to the bit; W is scratch; all (n, n)."""
    n = P.shape[0]
    for i in range(n):
        for j in range(n):
            s = 0.0
            for k in range(n):
                s += Phi[i, k] * P[k, j]
            W[i, j] = s
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                s += W[i, k] * Phi[j, k]
            P[i, j] = s
            P[j, i] = s


@kernel
def predict(x, u, p):
    """Advance x_hat = Phi x_hat + G u and P = Phi P Phi' to this sample."""
    for i in range(6):
        s = p.G[i] * u
        for k in range(6):
            s += p.Phi[i, k] * x.x_hat[k]
        x.W[0, i] = s
    for i in range(6):
        x.x_hat[i] = x.W[0, i]
    propagate(x.P, p.Phi, x.W)


@kernel
def correct(x, y, p):
    """Correct by the velocity sample y [rad/s] and return eta. [Jay] (5), (6), with K inside Phi's bracket."""
    gamma = p.K_v * (y - x.x_hat[3])
    S = p.K_v * p.K_v * x.P[3, 3] + p.R
    gain = p.K_v / S
    for i in range(6):
        x.W[0, i] = x.P[i, 3] * gain
    for i in range(6):
        x.x_hat[i] += x.W[0, i] * gamma
        for j in range(i + 1):
            x.P[i, j] -= x.W[0, i] * x.W[0, j] * S
            x.P[j, i] = x.P[i, j]
    return gamma / math.sqrt(S)


@kernel
def _decide(x, p):
    """Name a sensor: the velocity first, as what its filter says of the others counts only while it is healthy."""
    velocity = math.fabs(x.eta_bar) / p.th_eta
    position = math.fabs(x.R1) / p.th_R1
    current = math.fabs(x.R2) / p.th_R2
    x.r = velocity if velocity >= 1.0 else max(velocity, max(position, current))
    others = POSITION if position >= 1.0 else CURRENT if current >= 1.0 else 0.0
    x.isolated_part = VELOCITY if velocity >= 1.0 else others
    x.reconf = 1.0 if x.isolated_part == POSITION else x.reconf
    x.alarm = 1.0 if x.isolated_part > 0.0 else 0.0
    x.verdict = SENSOR if x.isolated_part > 0.0 else NONE


@kernel
def step(x, u, p, dt):
    """Predict to this sample, test the innovation, correct, form R1 and R2, decide; a missing sample only predicts."""
    ok = usable(u.y_velocity, u.velocity_valid) > 0.5
    see_position = usable(u.y_position, u.position_valid) > 0.5
    if x.started < 0.5:
        if p.engage > 0.5 and see_position:
            x.x_hat[2] = u.y_position / p.lead
            x.x_hat[0] = p.ratio * x.x_hat[2]  # no load: the spring is at rest
        x.started = 1.0
    else:
        demand = x.u_last if p.delay > 0.5 or not math.isfinite(u.u) else u.u
        predict(x, demand, p)
    x.u_last = u.u if math.isfinite(u.u) else x.u_last
    if ok:
        x.eta = x.window[int(x.head)] = correct(x, u.y_velocity, p)
        x.head = (x.head + 1.0) % N
        x.eta_bar = 0.0
        for i in range(N):
            x.eta_bar += x.window[i] / N
    x.pos_hat = p.lead * x.x_hat[2]
    x.pos_sigma = p.lead * math.sqrt(max(x.P[2, 2], 0.0))
    if see_position:
        x.R1 = u.y_position - x.pos_hat
    if usable(u.y_current, u.current_valid) > 0.5:
        x.R2 = u.y_current - x.x_hat[4]
    x.valid = 1.0 if ok and math.fabs(x.eta_bar) < p.th_eta else 0.0
    _decide(x, p)


rollout = entry(step, STATE, INPUTS, PARAMS)
