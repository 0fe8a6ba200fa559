"""Our figures beside slides 10 and 13 to 16 of [Mar10]: signature tables, chosen residuals and robustness."""

import numpy as np

from cosim.flight.plant.force_model import force_model
from cosim.papers.drawing import Curve, Drawing, Panel
from cosim.papers.mar10 import flights, vehicle_rows
from cosim.papers.mar10.rows import throttle_in_error
from cosim.table import Cell, Table
from fdi.control_redundancy import control_redundancy
from fdi.control_redundancy import structure as redundancy_structure

ROLES = (("ours", "solid"), ("second", "dash"), ("third", "dashdot"), ("true", "dot"))
TITLES = {
    1: "25 % of the thrust lost",
    2: "elevators locked, then 25 % of the thrust lost",
    3: "50 % of the thrust lost, then elevators, then rudder locked",
}


def drawings() -> list[Drawing]:
    """Return the Drawings."""
    flown = [_scenario(n) for n in TITLES]
    return [_table(), _own_table(), *flown, *vehicle_rows.drawings(), _robustness()]


def _signatures(structure):
    made = Table("", "family", "signature", *redundancy_structure.TALK_INPUTS, "residuals>", kind="")
    for family in redundancy_structure.families(structure):
        marks = (Cell("1", "good") if v else "0" for v in family.signature)
        made.add(family.name, "".join(str(int(v)) for v in family.signature), *marks, str(len(family.solved)))
    return made


def _table():
    found = redundancy_structure.signatures(redundancy_structure.TALK)
    title = f"The talk's structure: {sum(found.values())} residuals, {len(found)} signatures"
    caption = ("Made from the sparsity of the force equations alone. 1: a fault of that input moves the family's "
               "residuals. r1~2by3 is row 1 with input 2 replaced from row 3.")  # fmt: skip
    return Drawing("mar10", "slide 10", title, caption, table=_signatures(redundancy_structure.TALK))


def _own_table():
    own = force_model().structure()[:, [1, 0, 2, 3]]  # inputs in the order of the talk
    found = redundancy_structure.signatures(own)
    title = f"This aircraft: {sum(found.values())} residuals, {len(found)} signatures"
    caption = ("The coefficients that JSBSim flies have no aileron force and no rudder or aileron drag: forces alone "
               "do not see the aileron. Row 3 holds thrust too.")  # fmt: skip
    return Drawing("mar10", "slide 10", title, caption, table=_signatures(own))


def _scenario(number):
    """Draw the residuals of the families over their thresholds, nominal aircraft."""
    flown = flights.fly(number)
    p = flights.detector()
    log = flights.detector_log(flown, p)
    n = int(p["n_families"][0])
    ratio = log["res"][:, :n] / np.maximum(log["tau"][:, :n], 1e-12)
    ratio[log["tau"][:, :n] <= 0.0] = np.nan
    t, dt = flown.index.to_numpy() >= 20.0, 4 * flown.attrs["dt"]
    moved = [j for j in range(n) if np.nanmax(np.abs(ratio[t, j]), initial=0.0) > 1.0] or list(range(n))
    shown = np.where(t[:, None], ratio, np.nan)[::4]
    panels = [
        Panel(_family(p, j), "", (Curve("residual over threshold", shown[:, j], dt=dt),), (1.0, -1.0), 1.5)
        for j in moved
    ]
    declared = tuple(
        Curve(name, log["declared"][::4, h] * (h + 1.0), *ROLES[h], dt=dt)
        for h, name in enumerate(control_redundancy.ISOLABLE_PARTS[1:5])
        if log["declared"][:, h].any()
    )
    panels.append(Panel("declared", "", declared, limits=(-0.3, 4.5)))
    when = "; ".join(f"{name} at {at:g} s" for name, at in flights.TRUTH[number])
    return Drawing(
        "mar10",
        f"slide {12 + number}",
        f"Scenario {number}: {TITLES[number]}",
        f"Truth: {when}. Families of residuals that fire, over their thresholds, after a sliding mean of 0.5 s and the "
        "offset learned in the first 20 s; nominal coefficients, IMU of sensor set transport. Last: what is declared "
        "(1 elevator, 2 aileron, 3 rudder, 4 engine).",
        tuple(panels),
        onset=flights.TRUTH[number][0][1],
        span=(20.0, float(flown.index[-1])),
        row_px=150,
        look="the dashed thresholds: the families that a fault does not move stay between them until one does.",
    )


def _family(p, j):
    """Return the name of a family of the detector: its base row, the rows that replace inputs."""
    rows, inputs = "XYZLMN", ("elevator", "aileron", "rudder", "thrust")
    name = rows[int(p["base_row"][0, j])]
    for k in range(int(p["n_pivots"][0, j])):
        name += f", {inputs[int(p['pivot_input'][0, j, k])]} from {rows[int(p['pivot_row'][0, j, k])]}"
    return name


def _robustness():
    """Draw slide 16: throttle and its estimate by r~_14^5 while the elevator moves, g_12 exact and 5 % off."""
    t = np.arange(0.0, 10.0, 0.01)
    u = np.stack([0 * t, 0.05 * np.sign(np.sin(2 * np.pi * t / 5.0)), 0 * t, 0.55 - 0.1375 * (t >= 5.0)])
    command = np.stack([0 * t, u[1], 0 * t, 0.55 + 0 * t])
    off = []
    curves = [Curve("commanded", command[3], "quiet", "dot", dt=0.01), Curve("true", u[3], "true", dt=0.01)]
    for share, role, dash in ((0.0, "ours", "solid"), (0.05, "second", "dash")):
        estimate = command[3] + throttle_in_error(u, share, command)
        name = f"estimate, g_12 {100 * share:g} % off"
        curves.append(Curve(name, estimate, role, dash, dt=0.01))
        off.append(Curve(name, 1e3 * (estimate - u[3]), role, dash, dt=0.01))
    return Drawing(
        "mar10",
        "slide 16",
        "Robustness: throttle from r~_14^5 with g_12 5 % off, 25 % of the thrust lost at 5 s",
        "The documented vehicle; the elevator steps between +-0.05 rad. The residual is blind to the elevator, so that "
        "only 5 % of its drag comes through: small beside the fault.",
        (Panel("throttle", "", tuple(curves)), Panel("error of the estimate", "1/1000", tuple(off), least=0.5)),
        onset=5.0,
        span=(0.0, 10.0),
        row_px=220,
        look="5 s: both estimates step with the throttle, and what 5 % of g_12 adds is hardly to be seen.",
    )
