"""[Lu17] row by row: figures 2 to 7 without load, with a load that is left out, and with one that is known.

The bench and what the paper leaves open are in `lu17_bench`, the statistics in `lu17_stats`. "Unbiased" is tested: the
mean error of 100 seeds over its standard error is Student's t; a band of 3.39 (one quantity) or 3.72 (the largest of
three states) holds 99.9 % of an unbiased estimate. At the worst of 2400 instants the same probability needs 5.42 or
5.67 (Bonferroni). The caption of figure 2 says liquid OFC; by section IV.C, to which it belongs, it is the fault-free
case.
"""

import math

from cosim.papers.lu17 import bench, beyond
from cosim.papers.lu17 import reasons as why
from cosim.papers.lu17.stats import T_ONE, T_ONE_WORST, T_STATES, T_STATES_WORST, case, get, ratio, row

FLOWN = ("no load", "load left out")
SAYS = {  # scenario -> (of the state, of the fault)
    "fault-free": (
        'IV.C: "all the states are estimated in an unbiased sense"',
        'IV.C: "the estimation of the fault is close to zero"',
    ),
    "liquid OFC": (
        'IV.D: "the states are all estimated in an unbiased sense"',
        'IV.D: "the fault signal is also estimated in an unbiased sense"',
    ),
    "solid OFC": (
        'IV.E: "the state estimation performance is still satisfactory"; I: "in an unbiased sense"',
        'IV.E: "the fault estimation follows the dynamics of the fault"; I: "in an unbiased sense"',
    ),
    "liquid jamming": (
        'V.C: "able to estimate the states when the sensor is in error"; I: "in an unbiased sense"',
        'V.C: "the bias sensor fault is estimated in an unbiased sense"',
    ),
    "solid jamming": (
        'V.D: "the states of the actuator are still estimated in an unbiased sense"',
        'V.D: "the estimated fault matches closely with the true fault"; I: "in an unbiased sense"',
    ),
    "runaway": (
        'V.E: "the estimation of the states is unbiased as expected"',
        'V.E: "the fault reconstruction is unbiased"',
    ),
}


def _unbiased():
    """Yield the statistical test of every scenario, load, phase, of state and fault."""
    for scenario, says in SAYS.items():
        figure = bench.SCENARIOS[scenario][0]
        for load in bench.LOADS:
            phases = ("whole",) if scenario == "fault-free" else ("before", "after") if load in FLOWN else ("after",)
            for phase in phases:
                when = "" if phase == "whole" else f", {phase} the fault"
                where = f"{scenario}, {load}{when}"
                for name, letters, band, said in (
                    ("state", "(b)-(d)", T_STATES, says[0]),
                    ("fault", "(e)-(f)", T_ONE, says[1]),
                ):
                    yield row(
                        f"figure {figure}{letters}, {where}: mean {name} error over its standard error",
                        said,
                        get(name, scenario, load, phase),
                        0,
                        band,
                        why.biased(scenario, load),
                    )
        if scenario != "fault-free":
            for name, letters, band, said in (
                ("state", "(b)-(d)", T_STATES_WORST, says[0]),
                ("fault", "(e)-(f)", T_ONE_WORST, says[1]),
            ):
                yield row(
                    f"figure {figure}{letters}, {scenario}, no load, after the fault: the same at the worst instant, "
                    f"{name}",
                    said,
                    get(f"{name} instant", scenario),
                    0,
                    band,
                    why.biased(scenario, "no load"),
                )


def _follows():
    """Yield the claims on the rod before a fault: within 5 % of the 20 mm of command from the reference."""
    for load in FLOWN:
        yield row(
            f"figure 2(a), fault-free, {load}: rod farthest from reference [mm]",
            'IV.C: "can follow the command very well"',
            get("leaves", "fault-free", load, "whole"),
            0,
            1,
            why.leaves("fault-free", load),
        )
        yield row(
            f"figure 2(e), fault-free, {load}: rms of f_hat over the largest valve command",
            'IV.C: "close to zero"',
            ratio("f_hat rms", "u", "fault-free", load, ("whole", "whole")),
            0,
            0.1,
        )
        for scenario, says in (
            ("liquid OFC", 'IV.D: "can follow the command well until the liquid fault"'),
            ("solid OFC", 'IV.E: "no longer able to follow" after the fault'),
            ("liquid jamming", 'V.C: "deviates from the command after the liquid jamming fault"'),
            ("solid jamming", 'V.D: stuck after the fault, at null because the command is "close to zero"'),
            ("runaway", 'V.E: "deviates from the commanded position" after the fault'),
        ):
            yield row(
                f"figure {bench.SCENARIOS[scenario][0]}(a), {scenario}, {load}, before the fault: rod farthest from "
                "reference [mm]",
                says,
                get("leaves", scenario, load, "before"),
                0,
                1,
                why.leaves(scenario, load),
            )


def _oscillatory():
    for load in FLOWN:
        yield row(
            f"figure 3(a), liquid OFC, {load}: rms of rod - reference after the fault over before",
            'IV.D: "can follow the command well until the liquid fault"',
            ratio("leaves rms", "leaves rms", "liquid OFC", load, ("after", "before")),
            2,
            math.inf,
        )
        yield row(
            f"figure 3(f), liquid OFC, {load}: rms of the fault's error after the fault over before",
            'IV.D: "the estimation error increases slightly"',
            ratio("fault error rms", "fault error rms", "liquid OFC", load, ("after", "before")),
            1,
            2,
        )
        yield row(
            f"figure 4(a), solid OFC, {load}: rod farthest from where the fault found it [mm]",
            'IV.E: "only oscillates near the position when the fault is injected"; the command is 20 mm',
            get("wanders", "solid OFC", load),
            0,
            10,
            why.LEAK if load != "no load" else "",
        )
        yield row(
            f"figure 4(a), solid OFC, {load}: rod farthest from reference [mm]",
            'IV.E: "no longer able to follow the command"; the command is 20 mm',
            get("leaves", "solid OFC", load),
            10,
            math.inf,
        )
        yield row(
            f"figure 4(f), solid OFC, {load}: rms of the fault's error over that of the fault",
            'IV.E: "the estimation error is small"',
            ratio("fault error rms", "fault rms", "solid OFC", load),
            0,
            0.1,
            why.SOLID_SIZE,
        )


def _jammed():
    deviates = 'V.C: "deviates from the command after the liquid jamming fault"; the fault is 5 mm'
    for load in FLOWN:
        yield row(
            f"figure 5(a), liquid jamming, {load}, the estimate fed back: mean rod - reference, size [mm]",
            deviates,
            lambda load=load: abs(case("liquid jamming", load)["rod leaves", "after"]),
            2.5,
            7.5,
            why.drift(load) or why.FEEDBACK,
        )
        yield row(
            f"figure 5(a), liquid jamming, {load}, the measurement fed back: mean rod - reference, size [mm]",
            deviates,
            lambda load=load: abs(case("liquid jamming", load, measured=True)["rod leaves", "after"]),
            2.5,
            7.5,
        )
        yield row(
            f"figure 5(a), liquid jamming, {load}, the estimate fed back: mean sensor - reference [mm]",
            deviates,
            get("sensor leaves", "liquid jamming", load),
            2.5,
            7.5,
            why.drift(load),
        )
        yield row(
            f"figure 5(e), liquid jamming, {load}: mean f_hat over the 5 mm of bias",
            'V.C: "estimated in an unbiased sense"',
            get("f_hat", "liquid jamming", load, scale=1 / bench.BIAS),
            0.95,
            1.05,
            why.drift(load),
        )
        yield row(
            f"figure 6(a), solid jamming, {load}: surface farthest from null after the fault, as rod [mm]",
            'V.D: "remains at the null-position"',
            get("null", "solid jamming", load),
            0,
            1,
            why.drift(load),
        )
        yield row(
            f"figure 7(a), runaway, {load}: surface at the end, as rod [mm]; the stop is at 89.0",
            'V.E: "is stuck at the limit"',
            get("end", "runaway", load),
            88,
            90,
        )
        for scenario, figure in (("solid jamming", 6), ("runaway", 7)):
            yield row(
                f"figure {figure}(f), {scenario}, {load}: rms of the fault's error over that of the fault",
                'V.D: "matches closely"; V.E: "satisfactory"',
                ratio("fault error rms", "fault rms", scenario, load),
                0,
                0.1,
                why.drift(load),
            )


def plan():
    """Return what is asked of [Lu17], as Planned rows in the order of the paper and then what lies beyond it."""
    return [*_unbiased(), *_follows(), *_oscillatory(), *_jammed(), *beyond.plan()]


def rows():
    """Return the Rows of [Lu17]; half a minute of work."""
    return [p.judge() for p in plan()]
