"""Every kind of fault of an actuator, surface or engine flown: it does what its name says, and heals; or is refused.

The two left segments are hydraulic, the two right ones electromechanical; the inner one has the fault, the outer one is
its healthy twin on the same command.
"""

import math

import numpy as np
import pytest
from flown import deg, fault, fly, scenario

from actuators.constants import M_S_PER_KT
from actuators.ema import jay
from cosim.errors import ScenarioError
from cosim.flight.faults import inject
from cosim.scenario import catalog as c

START, END, LAST = 1.6, 5.0, 9.0  # [s] the first pulse of the 3-2-1-1 is under way, the second one too
ARM = {"hydraulic": 0.30, "ema": jay.values("elevator")["arm"]}  # [m] of rod per rad
LEAD = jay.values("elevator")["lead"]
SEGMENT = {"hydraulic": ("left_inner", "li", "lo"), "ema": ("right_inner", "ri", "ro")}
PARTS = ("hydraulic.left_inner.q_rod", "hydraulic.left_inner.x3", "hydraulic.left_outer.x3", "ema.right_inner.motor",
         "ema.right_inner.i", "ema.right_outer.i", "truth.aircraft.de_lo", "truth.aircraft.de_ri",
         "truth.aircraft.de_ro", "truth.aircraft.hm0_li", "truth.aircraft.hmd_li")  # fmt: skip


class Seen:
    """Own and twin angle [deg] within the fault, and the flight."""

    def __init__(self, f, technology):
        self.f, self.technology = f, technology
        _, own, twin = SEGMENT[technology]
        self.own_all, self.twin_all = (deg(getattr(f, n)) for n in (f"aircraft_de_{own}" if own != "li" else "de_li",
                                                                    f"aircraft_de_{twin}"))  # fmt: skip
        self.on = (f.t > START + 0.01) & (f.t < END - 0.01)
        self.late = (f.t > END - 1.5) & (f.t < END - 0.01)
        self.own, self.twin = self.own_all[self.on], self.twin_all[self.on]
        self.off = self.own - self.twin
        self.end = float(self.own[-1])

    def late_off(self):
        return float(np.median((self.own_all - self.twin_all)[self.late]))

    def sine(self, x, hz):
        """Return (amplitude, 1 sigma of the rest) of `x` over the fault."""
        t = self.f.t[self.on]
        basis = np.column_stack([np.sin(2 * math.pi * hz * t), np.cos(2 * math.pi * hz * t), np.ones(len(t)), t])
        best = np.linalg.lstsq(basis, x, rcond=None)[0]
        return math.hypot(best[0], best[1]), float(np.std(x - basis @ best))

    def peak(self, name):
        return float(np.abs(getattr(self.f, name)[self.on]).max())


def oscillates_about_the_command(amplitude):
    def check(s):
        size, rest = s.sine(s.off, 1.5)
        # the loop lets 0.85 (hydraulic) to 1.3 (EMA) of an oscillation of command or sensor through at 1.5 Hz
        assert 0.6 * amplitude[s.technology] < size < 1.5 * amplitude[s.technology]
        assert rest < 0.4 * size

    return check


def oscillates_instead_of_the_command(amplitude):
    def check(s):
        size, rest = s.sine(s.own, 1.5)
        assert 0.6 * amplitude[s.technology] < size < 1.5 * amplitude[s.technology]
        assert rest < 0.5 * size < np.std(s.twin)

    return check


def stands(most):
    def check(s):
        assert np.ptp(s.own) < most and np.ptp(s.twin) > 3.0

    return check


def runs_away(s):
    assert s.own[-1] > s.own[0] + 6.0 and np.diff(s.own).min() > -0.02  # drives down at 5 deg/s, load slows it


def runs_to_its_limit(s):
    assert abs(s.end - 4.0) < 0.15 and s.own.max() < 4.3


def weak(share):
    def check(s):
        assert np.ptp(s.own) < share * np.ptp(s.twin)

    return check


def obeys(share):
    def check(s):
        slow = np.abs(np.gradient(s.twin, 0.005)) < 1.0  # [deg/s] a smaller motion is over sooner
        assert np.ptp(s.twin[slow]) > 3.0
        assert np.polyfit(s.twin[slow], s.own[slow], 1)[0] == pytest.approx(share, abs=0.05)

    return check


def trails(s):
    hinge = deg(-s.f.aircraft_hm0_li / s.f.aircraft_hmd_li)[s.on][-1]  # where the hinge moment is zero
    # a driven-back screw stops where the hinge moment falls below its friction
    assert abs(s.end - hinge) < {"hydraulic": 0.5, "ema": 1.0}[s.technology]
    assert np.ptp(s.twin) > 3.0


def rubs(s):
    name = {"hydraulic": "{}_{}_x3", "ema": "{}_{}_i"}[s.technology]
    side = "left" if s.technology == "hydraulic" else "right"
    assert s.peak(name.format(side, "inner")) > 1.3 * s.peak(name.format(side, "outer"))
    assert np.std(s.off) > 0.1


def has_play(s):
    own = s.own_all[s.on]
    rod = {"hydraulic": s.f.left_inner_q_rod, "ema": s.f.right_inner_motor * LEAD}
    gap = own - deg(rod[s.technology] / ARM[s.technology])[s.on]
    assert 0.4 < 0.5 * np.ptp(np.quantile(gap, [0.03, 0.97])) < 0.8  # 1 deg of full width, and what the structure gives


def runs_to_a_stop(s):
    """60 % of the stall current against the hinge moment: to the stop, as fast as the drive can."""
    assert abs(s.end) > 10.0 and np.ptp(np.diff(s.own[-100:])) < 0.01


def draws_more_current(s):
    assert np.sqrt(np.mean(s.f.right_inner_i[s.on] ** 2)) > 1.5 * np.sqrt(np.mean(s.f.right_outer_i[s.on] ** 2))


def is_a_little_slower(s):
    # the current loop covers it until the voltage is at its limit: only the fastest motion shows it
    assert 0.02 < np.abs(s.off).max() < 0.5


DEG1 = {"hydraulic": 1.0, "ema": 1.0}
MM1 = {k: deg(1e-3 / arm) for k, arm in ARM.items()}  # of rod at its lever arm
SINE = {"frequency_hz": 1.5}


def is_off_by(expected):
    def check(s):
        assert s.late_off() == pytest.approx(expected, abs=0.1)

    return check


def lags(s):
    assert np.std(s.off) > 0.1


ELEVATOR = {
    "ofc_liquid valve": ({"at": "valve", "amplitude_mm": 1.0, **SINE}, oscillates_about_the_command(MM1)),
    "ofc_liquid command": ({"at": "command", "amplitude_deg": 1.0, **SINE}, oscillates_about_the_command(DEG1)),
    "ofc_liquid sensor": ({"at": "sensor", "amplitude_deg": 1.0, **SINE}, oscillates_about_the_command(DEG1)),
    "ofc_solid valve": ({"at": "valve", "amplitude_mm": 1.0, **SINE}, oscillates_instead_of_the_command(MM1)),
    "ofc_solid command": ({"at": "command", "amplitude_deg": 1.0, **SINE}, oscillates_instead_of_the_command(DEG1)),
    "bias": ({"bias_deg": 1.5}, is_off_by(1.5)),
    "jam_liquid": ({"bias_deg": 1.5}, is_off_by(-1.5)),
    "jam_solid": ({}, stands(0.05)),
    "jam": ({}, stands(0.4)),  # behind the seized screw the structure gives
    "runaway valve": ({"at": "valve", "rate_deg_s": 5.0}, runs_away),
    "runaway command": ({"at": "command", "rate_deg_s": 5.0, "limit_deg": 4.0}, runs_to_its_limit),
    "loss_of_effectiveness command": ({"at": "command", "loss_pct": 60.0}, obeys(0.4)),
    "loss_of_effectiveness valve": ({"at": "valve", "loss_pct": 95.0}, weak(0.6)),  # the servo makes up for 50 %
    "free_float": ({}, trails),
    "supply_pressure_drop": ({"loss_pct": 95.0}, weak(0.6)),
    "internal_leakage": ({"leakage_pct": 80.0}, weak(0.9)),
    "air_in_oil": ({"loss_pct": 95.0}, lags),
    "friction": ({"friction_pct": 60.0}, rubs),
    "backlash": ({"backlash_deg": 1.0}, has_play),
    "winding_resistance": ({"increase_pct": 1000.0}, is_a_little_slower),
    "magnet_loss": ({"loss_pct": 70.0}, draws_more_current),
    "hardover": ({"drive_pct": 60.0}, runs_to_a_stop),
}  # fmt: skip


def test_every_kind_of_elevator_fault_is_in_the_table():
    assert {name.split()[0] for name in ELEVATOR} == set(c.ELEVATOR_KINDS)
    for name in ELEVATOR:
        kind, _, at = name.partition(" ")
        assert not c.ELEVATOR_KINDS[kind].at or not at or at in c.ELEVATOR_KINDS[kind].at


@pytest.mark.parametrize("name", ELEVATOR)
def test_elevator_fault_does_what_its_name_says_and_heals(name):
    numbers, check = ELEVATOR[name]
    kind = name.split()[0]
    kinds = [t for t in SEGMENT if t in c.ELEVATOR_KINDS[kind].technologies]
    keys = {}
    for i, technology in enumerate(kinds):
        keys |= fault(i, f"elevator.{SEGMENT[technology][0]}", kind, START, END, **numbers)
    keys |= {"manoeuvre__start_s": 1.0, "manoeuvre__amplitude_deg": 5.0, "sensors__noise_scale": 0.0}
    keys["elevator__feedback"] = "measured"  # what a filter makes of a fault is not what is tested here
    f = fly(scenario("sun13", "three_two_one_one", duration_s=LAST, **keys), *PARTS)
    assert f.status == "completed"
    for technology in kinds:
        s = Seen(f, technology)
        before, after = f.t < START - 0.01, f.t > LAST - 1.0
        assert np.abs(s.own_all - s.twin_all)[before].max() < 0.01
        check(s)
        assert np.abs(s.own_all - s.twin_all)[after].max() < 0.1, "healed"


SURFACE = {"aileron.left": "da_l", "aileron.right": "da_r", "rudder": "dr", "stabiliser": "stab"}


@pytest.mark.parametrize("target", SURFACE)
def test_jam_and_runaway_of_the_other_surfaces(target):
    """A jam and then a runaway, each healed, in a turn; the aircraft comes back to its bank and altitude."""
    rate, limit = {"stabiliser": (-0.3, -3.0), "rudder": (5.0, 4.0)}.get(target, (5.0, 8.0))
    keys = fault(0, target, "jam", 6.5, 12.0)
    keys |= fault(1, target, "runaway", 20.0, 24.0, rate_deg_s=rate, limit_deg=limit)
    turn = scenario("sun13", "coordinated_turn", duration_s=60.0, manoeuvre__duration_s=30.0, **keys)
    f = fly(turn, "truth.aircraft.da_r")
    f.da_r = f.aircraft_da_r
    x = deg(getattr(f, SURFACE[target]))
    assert f.status == "completed"
    assert np.ptp(x[(f.t > 6.6) & (f.t < 12.0)]) < 0.01
    ran = x[(f.t > 20.0) & (f.t < 24.0)]
    assert (ran[-1] - ran[0]) * np.sign(rate) > 0.8
    assert abs(ran[-1] - limit) < 0.1 or target == "stabiliser"
    assert np.abs(deg(f.phi[f.t > 55.0])).max() < 2.0
    assert np.abs(deg(f.phi)).max() < 45.0
    assert abs(f.hdot[-1]) < 3.0


def test_thrust_loss_takes_thrust_and_gives_it_back():
    names = [f"truth.aircraft.thrust_{i}" for i in range(1, 5)]
    f = fly(scenario("E", duration_s=30.0, **fault(0, "engine.1", "thrust_loss", 5.0, 15.0, loss_pct=60.0),
                     **fault(1, "engine.4", "thrust_loss", 5.0, 15.0, loss_pct=100.0, ramp_s=2.0)), *names)  # fmt: skip
    on = (f.t > 8.0) & (f.t < 15.0)
    one, two, four = f.aircraft_thrust_1, f.aircraft_thrust_2, f.aircraft_thrust_4
    np.testing.assert_allclose(one[on] / two[on], 0.4, atol=0.02)
    assert np.abs(four[on]).max() < 0.02 * two[on].min()
    np.testing.assert_allclose(four[f.t > 17.0] / two[f.t > 17.0], 1.0, atol=0.02)
    assert f.cas[f.t < 15.0].min() < f.cas[0] - 2 * M_S_PER_KT
    assert f.status == "completed" and deg(np.abs(f.phi[f.t > 28.0]).max()) < 1.0


@pytest.mark.parametrize("first", sorted(k for k, v in c.ELEVATOR_KINDS.items() if v.exclusive not in ("", "at")))
def test_two_faults_that_take_over_the_same_thing_are_refused(first):
    """Every pair of kinds that needs the same part of one actuator, on any technology that has both."""
    numbers = {"drive_pct": 50.0, "loss_pct": 10.0}
    numbers |= {"leakage_pct": 10.0, "friction_pct": 10.0, "backlash_mm": 1.0, "increase_pct": 10.0}
    one = c.ELEVATOR_KINDS[first]
    for second, other in c.ELEVATOR_KINDS.items():
        both = [t for t in one.technologies if t in other.technologies]
        if other.exclusive != one.exclusive or not both:
            continue
        keys = {}
        for i, (kind, spec) in enumerate(((first, one), (second, other))):
            own = {k.name: numbers[k.name] for k in spec.one_of[:1] if k.name in numbers}
            keys |= fault(i, "elevator.left_inner", kind, 1.0 + i, 5.0, **own)
        with pytest.raises(ScenarioError, match="take over"):
            scenario("sun13", elevator__left_inner=both[0], elevator__feedback="measured", **keys)


@pytest.mark.parametrize("other", ["ofc_solid", "runaway"])
def test_loss_of_effectiveness_is_refused_beside_what_replaces_the_command(other):
    numbers = {"ofc_solid": {"at": "command", "amplitude_deg": 1.0, "frequency_hz": 1.0},
               "runaway": {"rate_deg_s": 5.0, "limit_deg": 4.0}}[other]  # fmt: skip
    keys = fault(0, "elevator.left_inner", "loss_of_effectiveness", START, END, loss_pct=50.0)
    with pytest.raises(ScenarioError, match="take over"):
        scenario("sun13", **keys, **fault(1, "elevator.left_inner", other, START, END, **numbers))


@pytest.mark.parametrize("kind", c.ELEVATOR_KINDS)
def test_kind_is_refused_on_an_actuator_that_cannot_have_it(kind):
    spec = c.ELEVATOR_KINDS[kind]
    value = {k.name: max(k.low, 0.0) + 0.5 * (k.high - max(k.low, 0.0)) for k in (*spec.one_of[:1], *spec.keys)}
    for technology in {t.name for t in c.SHIPPED} - set(spec.technologies):
        with pytest.raises(ScenarioError, match="is a fault of"):
            scenario("sun13", elevator__left_inner=technology, elevator__feedback="measured",
                     **fault(0, "elevator.left_inner", kind, START, END, **value))  # fmt: skip


def test_every_kind_has_a_place_in_the_loop():
    """No kind that the catalog accepts is ignored by the injection: each finds at least one input of the tick."""
    known = {*inject.SENSOR_SHAPES, *(kind for t in c.TECHNOLOGIES.values() for kind in t.effects)}
    own_branch = {"ofc_solid", "runaway", "thrust_loss"}
    assert set(c.ALL_KINDS) - known == own_branch
