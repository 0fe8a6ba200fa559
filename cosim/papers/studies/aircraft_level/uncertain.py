"""What wrong coefficients do to the elevator estimate of [Alwi14], coefficient by coefficient and in draws.

The simultaneous faults of section 6 (elevator 3 deg, n_z 0.5 g, alpha 5 deg, sensors on the observers' copy) at points
A to E with the doublet of 0.15 g; the mean of the last 5 s, offset learned up to 8 s as the detector flies. After the
fault the automatic trim moves the stabiliser until the elevators are free again, so that the pitching moments balance,

    Cm_de f + Cm_ds (change of the stabiliser) = 0,

and all that any observer of the motion can say is f = -(Cm_ds / Cm_de) of its model times that change: an error of
either coefficient, and nothing else, comes out as an error of f as large as the stabiliser's share.
"""

from typing import Any

import numpy as np

from cosim.flight.detectors import sources
from cosim.flight.plant.point import SIX
from cosim.flight.signals import detect, fly
from cosim.flight.site import site
from cosim.papers.studies import Options, Table
from cosim.scenario.load import load_scenario
from cosim.scenario.tolerance import toleranced
from fdi.lpv_smo import lpv_smo

POINTS = {name: SIX[name] for name in "ABCDE"}
ONSET, END = 10.0, 30.0  # [s]
WRONG, BOUND = 0.05, 8.0  # of each coefficient; [%]
FAULT = {"f_hat_elevator": np.radians(3.0), "f_hat_n_z": 0.5, "f_hat_alpha": np.radians(5.0)}
SHOWN = 0.05  # [%]: coefficients below that are left out


def errors(point: str, coefficient: Any = "", draw: Any = -1) -> Any:
    """Return the errors [%] of elevator, n_z and alpha and the stabiliser's movement [deg] of one flight.

    `coefficient` is 5 % too large, or with `draw` >= 0 every one is 5 % off, up or down at random.
    """
    changes = [*(f"flight.{k}={v}" for k, v in POINTS[point].items()), "detectors.enabled=[]"]
    if coefficient:
        changes.append(f"tolerances.aero.{coefficient}={1 + WRONG}")
    if draw >= 0:
        rng = np.random.default_rng([ord(point), draw])
        changes += [f"tolerances.aero.{n}={1 + WRONG * rng.choice((-1, 1))}" for n in toleranced("aero")]
    wires = sources("lpv_smo")
    flown = fly(load_scenario("alwi14-simultaneous", changes), wires.values())
    p = lpv_smo.fitted(site(flown.attrs["dt"]))
    log, late = detect(flown, lpv_smo, wires, p), flown.index >= END - 5.0
    stab = flown[wires["stab"]].to_numpy()
    moved = np.degrees(stab[late].mean() - stab[flown.index < ONSET].mean())
    return [*(float(100 * (log[k][late].mean() / f - 1)) for k, f in FAULT.items()), float(moved)]


def _cases(draws):
    single = [(p, n, -1) for n in ("", *toleranced("aero")) for p in POINTS]
    return [*single, *((p, "", d) for p in POINTS for d in range(draws))]


def jobs(options: Options) -> list[Any]:
    """Return the flights: each coefficient alone, and draws of all."""
    return [(errors, dict(zip(("point", "coefficient", "draw"), key))) for key in _cases(options.seeds)]


def tables(options: Options, values: Any) -> list[Table]:
    """Return the tables: elevator error by coefficient, and over draws per point."""
    names, draws = toleranced("aero"), options.seeds
    got = dict(zip(_cases(draws), values))
    change = {n: [got[p, n, -1][0] - got[p, "", -1][0] for p in POINTS] for n in names}
    rows = [(n, *change[n]) for n in sorted(names, key=lambda n: -max(map(abs, change[n])))]
    rows = [("nominal", *(got[p, "", -1][0] for p in POINTS)), *(r for r in rows if max(map(abs, r[1:])) > SHOWN)]
    both = [abs(a) + abs(b) for a, b in zip(change["Cm_de"], change["Cm_ds"])]
    share = [-got[p, "", -1][3] for p in POINTS]
    rows += [("Cm_de and Cm_ds, worst signs", *both), ("stabiliser moved up to then [deg]", *(-s for s in share))]
    first = Table("elevator estimate, 3 deg on all segments: error [%], and what 5 % more of a coefficient adds",
                  ("coefficient", *(f"{p}>" for p in POINTS)), rows)  # fmt: skip
    all_ = np.array([[got[p, "", d][:3] for d in range(draws)] for p in POINTS])
    rows = []
    for i, name in enumerate(("elevator", "n_z", "alpha")):
        e = np.abs(all_[:, :, i])
        rows.append((name, float(np.median(e)), float(np.quantile(e, 0.95)), float(e.max()),
                     float(100 * (e <= BOUND).mean())))  # fmt: skip
    head = ("fault", "median [%]>", "95 % [%]>", "largest [%]>", f"within {BOUND:g} % [% of flights]>")
    title = f"every coefficient 5 % off, up or down, {draws} draws at each point: error of the estimate"
    return [first, Table(title, head, rows)]
