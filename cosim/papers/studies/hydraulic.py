"""What the study of the hydraulic detectors asks: its flights (`hydraulic_cases`, `hydraulic_loop`), and their tables.

    cosim study hydraulic
"""

import functools
from dataclasses import asdict, replace

import numpy as np

from cosim.papers.studies import Question
from cosim.papers.studies import hydraulic_cases as s
from cosim.papers.studies.hydraulic_loop import FEEDBACKS, feedback_flight, long_flight
from cosim.training.train_hydraulic import EVALUATION

ABOUT = "What the hydraulic detectors see of which fault, how soon, under which name."
# Seeds of these flights. On 17000 to 17059, 18000 to 18059 and 33000 to 33305 the decision was amended: a signal in
# place of the drive is searched for where nothing else tells of a fault, windows that show a missing drive name no
# oscillation, the pressure sensor is judged, a large input fault needs less time
FIRST = EVALUATION + 20000
SEARCH = EVALUATION + 8000  # of the search for the smallest amplitude
FORMS = ("iotsekf", "iotsekf load 1", "iotsekf load 0", "ofc_monitor")
SEARCH_SEEDS = 20
SHARE = 0.95


def _jobs(cases, options):
    seeds = range(FIRST, FIRST + options.seeds)
    return [(s.fly_case, {"case": asdict(c), "seed": seed, "noise": options.noise}) for c in cases for seed in seeds]


def _found(cases, values):
    """Return [(case, {detector: [Outcome]})] in the order of `_jobs`."""
    n = len(values) // len(cases)
    out = []
    for i, case in enumerate(cases):
        flown = values[n * i : n * (i + 1)]
        out.append((case, {name: [s.Outcome(**v[name]) for v in flown] for name in flown[0]}))
    return out


def _of(n, total):
    return None if n is None else f"{n}/{total}"


def _oscillations(cases, values, options):
    """Return the table of oscillations: one row a case, iotsekf in full, what the others find in time."""
    rows = []
    for case, found in _found(cases, values):
        row = s.summary(case, found["iotsekf"])
        n = row["runs"]
        others = [s.summary(case, found[name]) for name in FORMS[1:]]
        rows.append([case.name, _of(row["in_time"], n), row["delay_median_s"] * case.hz, row["delay_95_s"] * case.hz,
                     _of(row["right"], n), _of(row["frequency_right"], n), row["early"],
                     *(_of(o["in_time"], n) for o in others)])
    title = (f"iotsekf: alarm within 3 periods, verdict OFC and frequency within 25 % by 4 periods; "
             f"noise x{options.noise:g}; beside it what others alarm at within 3 periods")
    return [(title, ("case", "in time>", "median [T]>", "95 % [T]>", "OFC>", "and Hz>", "early>",
                     *(f"{name.removeprefix('iotsekf ')}>" for name in FORMS[1:])), rows)]


def _injected(cases, values):
    rows = []
    for i, case in enumerate(cases):
        u, q = np.array(values[3 * i : 3 * i + 3]).T
        rows.append([case.name, float(u.mean()), *(float(1e3 * v) for v in (q.min(), q.mean(), q.max()))])
    title = "amplitudes: injected at the valve, achieved at the rod (three flights each, against their twins)"
    return [(title, ("case", "u injected>", "rod least [mm]>", "mean>", "most>"), rows)]


def _others(options, values):
    cases = s.others()
    rows = []
    for case, found in _found(cases, values):
        for name in ("iotsekf", "rtsekf_flight", "position_monitor"):
            row = s.summary(case, found[name])
            n = row["runs"]
            if name != "iotsekf" and not row["detected"] and not row["early"]:
                continue
            moves = case.group in ("runaway", "jam_solid")
            deviation, off = (row["deviation_max_deg"], row["off_max_deg"]) if moves else (None, None)
            culprits = sum(o.culprit == case.culprit for o in found[name]) if case.culprit else None
            rows.append([case.name, name, _of(row["detected"], n), _of(row["in_time"], n), row["delay_median_s"],
                         row["delay_95_s"], deviation, off, row["early"], _of(row["right"], n), _of(culprits, n),
                         ", ".join(f"{k} {v}" for k, v in row["named"].items())])
    return [("delays [s] from the onset (of the command's step, for a jam); early: alarms before it or elsewhere; "
             "class and culprit at the end", ("case", "detector", "detected>", "in time>", "median>", "95 %>",
             "moved at alarm [deg]>", "off twin [deg]>", "early>", "right>", "right culprit>", "class at the end"),
             rows)]


def _confusion(options, values):
    """Return the verdict of iotsekf at the end of the look, by class; an OFC at four periods."""
    cases = [*s.oscillations(), *s.others()]
    counts: dict[str, dict[str, int]] = {}
    columns: dict[str, None] = {}
    for case, found in _found(cases, values):
        own = counts.setdefault(case.group, {})
        for o in found["iotsekf"]:
            name = f"sensor {o.culprit}" if o.last == "sensor" else o.last
            own[name] = own.get(name, 0) + 1
            columns[name] = None
    order = sorted(columns)
    rows = [[group, sum(own.values()), *(own.get(name, 0) or None for name in order)] for group, own in counts.items()]
    return [("iotsekf: what is wrong (rows) and what it is called", ("", "flights>", *(f"{c}>" for c in order)), rows)]


def _search(solid, options):
    cases = [s.oscillation(hz, solid=solid, mm=mm) for hz in s.FREQUENCIES for mm in s.AMPLITUDES]
    n = min(options.seeds, SEARCH_SEEDS)
    jobs = [(s.fly_case, {"case": asdict(c), "seed": SEARCH + k, "noise": options.noise})
            for c in cases for k in range(n)]
    achieved = [(s.achieved, {"case": asdict(c), "seed": SEARCH}) for c in cases]
    return cases, jobs, achieved


def _smallest(solid, options, values):
    cases, jobs, _ = _search(solid, options)
    flown, achieved = values[: len(jobs)], values[len(jobs) :]
    size = {(c.hz, c.fault["amplitude_mm"]): a for c, a in zip(cases, achieved)}
    good = {}
    for case, found in _found(cases, flown):
        for name, runs in found.items():
            hits = sum(o.delay <= case.limit_s + s.DT / 2 and not o.early for o in runs)
            good[name, case.hz, case.fault["amplitude_mm"]] = hits >= SHARE * len(runs)
    rows = []
    for hz in s.FREQUENCIES:
        row = [f"{hz:g} Hz"]
        for name in FORMS:
            least = None
            for mm in s.AMPLITUDES[::-1]:
                if not good[name, hz, mm]:
                    break
                least = mm
            if least is None:
                row.append("> 8")
            else:
                u, q = size[hz, least]
                row.append(f"{least:g} ({u:.2g}, {1e3 * q:.2g})")
        rows.append(row)
    kind = "solid" if solid else "liquid"
    return [(f"{kind} OFC in manoeuvre and light turbulence: smallest amplitude [mm] found within 3 periods in 95 % of "
             f"{min(options.seeds, SEARCH_SEEDS)} seeds, as all larger ones (u injected, mm achieved)",
             ("frequency", *(f"{name}>" for name in FORMS)), rows)]


def _feedback_jobs(options):
    seeds = range(FIRST, FIRST + min(options.seeds, 20))
    return [(feedback_flight, {"feedback": f, "reconfigure": r, "seed": n}) for f, r in FEEDBACKS for n in seeds]


def _feedback(options, values):
    n = len(values) // len(FEEDBACKS)
    rows = []
    for i, (feedback, reconfigure) in enumerate(FEEDBACKS):
        flown = values[n * i : n * (i + 1)]
        worst = {k: max(v[k] for v in flown) for k in flown[0]}
        name = feedback + (", reconfigure" if reconfigure else "")
        rows.append([name, worst["tracking_deg"], worst["nz_free_g"], worst["peak_deg"], worst["late_deg"],
                     worst["nz_g"], _of(sum(v["iotsekf"] for v in flown), n),
                     _of(sum(v["rtsekf_flight"] for v in flown), n)])
    return [(f"5 mm (0.95 deg) on the left inner rod sensor, {n} flights each with doublet and light turbulence: the "
             "largest, against the same flight without the fault; healthy n_z against `measured`",
             ("feedback", "healthy: off reference [deg]>", "n_z [g]>", "jam: peak [deg]>", "after 2 s [deg]>",
              "n_z [g]>", "iotsekf says sensor>", "rtsekf_flight>"), rows)]


def _long(options, values):
    rows = []
    for name, fields in values[0]["rows"].items():
        rows.append([name, *fields])
    minutes = [f"{m} min>" for m in values[0]["minutes"]]
    return [("one flight of 10 minutes, a doublet, light turbulence, no fault: largest of two segments in the minute",
             ("", *minutes), rows)]


def questions() -> list[Question]:
    """Return the Questions of the study."""
    ofc, reach, rest = s.oscillations(), s.oscillations(mm=0.3)[:14], s.others()
    at = [(s.achieved, {"case": asdict(c), "seed": FIRST + k}) for c in ofc[:14] for k in range(3)]
    made = [
        Question("ofc", "oscillations of 0.6 mm: in time, named, frequency (28 cases; 15 min)",
                 lambda o: _jobs(ofc, o), lambda o, v: _oscillations(ofc, v, o)),
        Question("reach", "the same of 0.3 mm, in turbulence (14 cases; 7 min)",
                 lambda o: _jobs(reach, o), lambda o, v: _oscillations(reach, v, o)),
        Question("achieved", "what 0.6 mm is at the valve and at the rod (1 min)",
                 lambda o: at, lambda o, v: _injected(ofc[:14], v)),
        Question("others", "runaway, jam, sensors of rod, surface, pressure (25 cases; 10 min)",
                 lambda o: _jobs(rest, o), _others),
        Question("confusion", "verdicts by class, from the flights of ofc and others",
                 lambda o: _jobs([*ofc, *rest], o), _confusion),
        Question("liquid", "smallest liquid OFC for each frequency, load form and ofc_monitor (15 min)",
                 lambda o: _search(False, o)[1] + _search(False, o)[2], functools.partial(_smallest, False)),
        Question("solid", "smallest solid OFC (15 min)",
                 lambda o: _search(True, o)[1] + _search(True, o)[2], functools.partial(_smallest, True)),
        Question("feedback", "the four servo feedbacks with and without a liquid jam (5 min)", _feedback_jobs,
                 _feedback),
        Question("load", "ten minutes: rtsekf as published drifts, rtsekf_flight does not; ema_kalman against hinge "
                 "load (1 min)", lambda o: [(long_flight, {"seed": FIRST})], _long),
    ]
    return [replace(question, seeds=60) for question in made]
