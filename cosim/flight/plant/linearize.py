"""Linear model of the bare airframe at a flight point: A, B, C, D by central differences about the trim, and the modes.

    x' = A dx + B du,   dy = C dx + D du        deviations from the trim, SI and radians

Engines are at the thrust of their throttle (no spool lag), actuators and control law are not part of it. `modes` are
those of the classical four-state blocks, (tas, alpha, q, theta) and (beta, p, r, phi), as the references give them:
altitude and heading are held, so the density gradient, which raises the phugoid's frequency by g/H over 2 g^2/V^2, is
left out there; it is in A, and `height_free` is the phugoid of A itself. About a turn the two blocks are coupled: A has
it, the modes of the blocks have not.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import CosimError, among, told_at_call
from cosim.files import beside
from cosim.flight.plant.jsbsim_signals import Border
from cosim.flight.plant.plant import Plant
from cosim.flight.plant.point import FlightPoint
from cosim.flight.plant.trim import EARTH_MERIDIAN, Trim
from cosim.scenario import Scenario, load_scenario

STATES = {
    "tas": "m/s", "alpha": "rad", "q": "rad/s", "theta": "rad", "h": "m",
    "beta": "rad", "p": "rad/s", "r": "rad/s", "phi": "rad", "psi": "rad",
}  # fmt: skip
OUTPUTS = {
    "nx": "1", "nz": "1", "hdot": "m/s", "q": "rad/s", "tas": "m/s", "alpha": "rad", "theta": "rad", "h": "m",
    "ny": "1", "beta": "rad", "p": "rad/s", "r": "rad/s", "phi": "rad", "psi": "rad", "cas": "m/s", "gamma": "rad",
    "pdot": "rad/s2", "qdot": "rad/s2", "rdot": "rad/s2",
}  # fmt: skip
INPUT_STEP = 2e-3
STEPS = dict.fromkeys(STATES, 2e-3) | {"tas": 0.5, "h": 5.0}
LONGITUDINAL, LATERAL = ("tas", "alpha", "q", "theta"), ("beta", "p", "r", "phi")


def _places(kind, there, names):
    """Return the positions of `names` among the states, inputs or outputs that are `there`."""
    for name in names:
        among(name, there, f"unknown {kind} {name!r}", error=CosimError)
    return [list(there).index(name) for name in names]


@dataclass(frozen=True)
class Mode:
    """A mode: natural frequency [rad/s], damping ratio, eigenvalue with non-negative imaginary part."""

    name: str
    wn: float
    zeta: float
    eigenvalue: complex

    def to_dict(self) -> dict[str, object]:
        """Return the mode as plain data: name, wn_rad_s, zeta, eigenvalue as [real, imaginary] in 1/s."""
        root = [self.eigenvalue.real, self.eigenvalue.imag]
        return {"name": self.name, "wn_rad_s": self.wn, "zeta": self.zeta, "eigenvalue": root}


@dataclass(frozen=True)
class LinearModel:
    """Trim, names with units, A (10, 10), B (10, m), C (19, 10), D (19, m), trim values x0, u0, y0 and modes."""

    trim: Trim
    states: dict  # {name: unit}, in the order of A's rows
    inputs: dict  # {name: unit}, of B's columns
    outputs: dict  # {name: unit}, of C's rows
    A: np.ndarray  # (n, n), x' = A (x - x0) + B (u - u0)
    B: np.ndarray  # (n, m)
    C: np.ndarray  # (p, n), y - y0 = C (x - x0) + D (u - u0)
    D: np.ndarray  # (p, m)
    x0: np.ndarray  # (n,), the trimmed state
    u0: np.ndarray  # (m,)
    y0: np.ndarray  # (p,)
    modes: list  # of the bare airframe, height and heading held: name, wn [rad/s], zeta, eigenvalue [1/s]
    height_free: Mode  # the phugoid of A, in which height moves

    def __repr__(self) -> str:
        t, sizes = self.trim, f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        modes = (f"  {m.name:<14} {m.wn:8.4f} rad/s, damping {m.zeta:.3f}" for m in self.modes)
        at = f"alpha {math.degrees(t.alpha):.2f} deg, {t.tas:.1f} m/s, {t.altitude:.0f} m, throttle {t.throttle:.2f}"
        return "\n".join([f"LinearModel: {sizes}; trim at {at}", *modes])

    def named(self, stem: str) -> tuple[str, ...]:
        """Return the inputs whose names begin with `stem`: "de_" the elevator segments, "throttle_" the engines."""
        return tuple(name for name in self.inputs if name.startswith(stem))

    def block(
        self, states: Any, inputs: Any = None, outputs: Any = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return (A, B, C, D) of the named states, inputs and outputs. Raises CosimError for a name it has not."""
        i = _places("state", self.states, states)
        j = _places("input", self.inputs, self.inputs if inputs is None else inputs)
        k = _places("output", self.outputs, self.outputs if outputs is None else outputs)
        return self.A[np.ix_(i, i)], self.B[np.ix_(i, j)], self.C[np.ix_(k, i)], self.D[np.ix_(k, j)]

    def to_control(self, states: Any = None, inputs: Any = None, outputs: Any = None) -> Any:
        """Return the control.StateSpace (python-control) of the named states, inputs and outputs (default: all), with
        their names. Raises CosimError without python-control."""
        try:
            from control import StateSpace
        except ImportError:
            raise CosimError("to_control needs python-control", remedy="pip install control") from None
        names = [list(all_ if own is None else own)
                 for own, all_ in ((states, self.states), (inputs, self.inputs), (outputs, self.outputs))]  # fmt: skip
        of = dict(zip(("states", "inputs", "outputs"), names))
        return StateSpace(*self.block(*names), **of, name="aircraft")

    def to_dict(self) -> dict[str, Any]:
        """Return what `cosim linearize --json` prints."""
        t = self.trim
        return {
            "trim": {
                "alpha_deg": math.degrees(t.alpha), "stabilizer_deg": math.degrees(t.stabilizer),
                "throttle": t.throttle, "elevator_deg": math.degrees(t.elevator), "theta_deg": math.degrees(t.theta),
                "tas_m_s": t.tas, "altitude_m": t.altitude, "nz": t.nz, "residual": t.residual,
            },
            "states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs),
            "units": {**self.states, **self.inputs, **self.outputs},
            "x0": self.x0.tolist(), "u0": self.u0.tolist(), "y0": self.y0.tolist(),
            "A": self.A.tolist(), "B": self.B.tolist(), "C": self.C.tolist(), "D": self.D.tolist(),
            "modes": [m.to_dict() for m in self.modes],
            "phugoid_height_free": self.height_free.to_dict(),
        }  # fmt: skip

    def save(self, path: str | Path) -> None:
        """Write the model to `path`, .npz or .mat by its ending: matrices, names, units, and as JSON text `summary` its
        trim and modes. Other endings raise ValueError."""
        path = Path(path)
        if path.suffix not in (".npz", ".mat"):
            raise ValueError(f"{path.name}: give a name that ends in .npz or .mat")
        text = str if path.suffix == ".npz" else object  # cells of MATLAB's
        rest = {k: v for k, v in self.to_dict().items() if k in ("trim", "modes", "phugoid_height_free")}
        data: dict = {k: getattr(self, k) for k in ("A", "B", "C", "D", "x0", "u0", "y0")}
        for kind, table in (("states", self.states), ("inputs", self.inputs), ("outputs", self.outputs)):
            data |= {kind: np.array([*table], text), f"{kind}_units": np.array([*table.values()], text)}
        with beside(path, model_file) as part:
            if text is str:
                np.savez(part, **data, summary=json.dumps(rest))
            else:
                from scipy.io import savemat

                savemat(part, {**data, "summary": json.dumps(rest)})


def model_file(path: Path) -> bool:
    """Tell whether a file is a model that `save` wrote."""
    from scipy.io import whosmat

    try:
        names = {*np.load(path)} if path.suffix == ".npz" else {name for name, *_ in whosmat(path)}
    except Exception:  # what these libraries make of other files is not told
        return False
    return {"A", "B", "C", "D", "states_units"} <= names


def input_units(border: Border) -> dict[str, str]:
    """Return {input: unit} of the linear model: elevator segments, stabiliser, ailerons, rudder, throttles."""
    angles = (*border.elevators, "stab", "da_l", "da_r", "dr")
    return {**dict.fromkeys(angles, "rad"), **dict.fromkeys(border.throttles, "1")}


@told_at_call
def linearize(flight: FlightPoint | Scenario | str) -> LinearModel:
    """Return the LinearModel about the trim at `flight`: a Scenario, the name or file of one, or a FlightPoint.

    Raises TrimError where there is no steady flight, ScenarioError for a name or a file that is no scenario.
    """
    if not isinstance(flight, FlightPoint):
        flight = FlightPoint.of(flight if isinstance(flight, Scenario) else load_scenario(flight))
    plant = Plant(flight.calm)
    trim = plant.trim()
    inputs = input_units(plant.border)
    u0 = trim.surfaces[plant.border.column(tuple(inputs))]
    x0 = np.array([trim.tas, trim.alpha, trim.q, trim.theta, trim.altitude, 0.0, trim.p, trim.r, trim.phi, 0.0])
    A, C = _slopes(lambda x: _evaluate(plant, x, u0), x0, np.array(list(STEPS.values())))
    B, D = _slopes(lambda u: _evaluate(plant, x0, u), u0, np.full(len(inputs), INPUT_STEP))
    y0 = _evaluate(plant, x0, u0)[1]
    return LinearModel(trim, STATES, inputs, OUTPUTS, A, B, C, D, x0, u0, y0, modes(A), height_free(A))


def _evaluate(plant, x, u):
    """Return (x', y) at one state and input."""
    tas, alpha, q, theta, h, beta, p, r, phi, psi = x
    surfaces = np.zeros(len(plant.border.inputs))
    surfaces[plant.border.column(tuple(input_units(plant.border)))] = u
    plant.place(
        tas=tas, alpha=alpha, theta=theta, altitude=h, beta=beta, phi=phi, psi=psi, p=p, q=q, r=r, surfaces=surfaces
    )
    t = plant.truth()[0]
    tas_dot = (t.u * t.udot + t.v * t.vdot + t.w * t.wdot) / tas
    alpha_dot = (t.u * t.wdot - t.w * t.udot) / (t.u**2 + t.w**2)
    beta_dot = (tas * t.vdot - t.v * tas_dot) / (tas**2 * math.cos(beta))
    turn = q * math.sin(phi) + r * math.cos(phi)
    # the horizon turns under the aircraft
    theta_dot = q * math.cos(phi) - r * math.sin(phi) + tas / (EARTH_MERIDIAN + h)
    x_dot = [
        tas_dot, alpha_dot, t.qdot, theta_dot, t.hdot, beta_dot, t.pdot, t.rdot, p + math.tan(theta) * turn,
        turn / math.cos(theta),
    ]  # fmt: skip
    return np.array(x_dot), np.array([t[name] for name in OUTPUTS])


def _slopes(f, z0, steps):
    columns = []
    for step, d in zip(steps, np.diag(steps)):
        columns.append([(up - down) / (2 * step) for up, down in zip(f(z0 + d), f(z0 - d))])
    return tuple(np.column_stack(column) for column in zip(*columns))


def modes(A: np.ndarray) -> list:
    """Return short_period, phugoid, dutch_roll, roll and spiral of A in the order of STATES, from the four-state
    blocks."""
    names = list(STATES)

    def roots(block):
        i = [names.index(s) for s in block]
        return np.linalg.eigvals(A[np.ix_(i, i)])

    slow = sorted(roots(LONGITUDINAL), key=lambda v: (abs(v), v.imag))  # real roots are paired by size
    *rest, b, a = sorted(roots(LATERAL), key=abs)
    if swing := [v for v in (*rest, b, a) if v.imag > 1e-9]:
        dutch = swing[-1], swing[-1].conjugate()
        rest = [v for v in (*rest, b, a) if all(abs(v - root) > 1e-9 for root in dutch)]
    else:
        dutch = a, b
    return [_mode("short_period", slow[3], slow[2]), _mode("phugoid", slow[1], slow[0]),
            _mode("dutch_roll", *dutch), _mode("roll", rest[-1]), _mode("spiral", rest[0])]  # fmt: skip


def height_free(A: np.ndarray) -> Mode:
    """Return the phugoid of A in the order of STATES: the slowest pair of roots of tas, alpha, q, theta and h."""
    i = [list(STATES).index(s) for s in (*LONGITUDINAL, "h")]
    _, a, b, *_ = sorted(np.linalg.eigvals(A[np.ix_(i, i)]), key=lambda v: (abs(v), v.imag))  # the first is height
    return _mode("phugoid_height_free", b, a)


def _mode(name, a, b=None):
    """Return the Mode of a pair (wn^2 = a b, 2 zeta wn = -(a + b)) or of one root (wn = |a|, zeta = -a/|a|)."""
    a = complex(a)
    if b is None:
        wn = abs(a)
        return Mode(name, wn, -a.real / wn if wn > 0 else 1.0, complex(a.real, abs(a.imag)))
    product, total = (a * complex(b)).real, (a + complex(b)).real
    wn = math.sqrt(abs(product))
    return Mode(name, wn, -total / (2 * wn), complex(a.real, abs(a.imag)))
