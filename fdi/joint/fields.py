"""What the joint verdict is given, holds and tells, a field each: records of `fdi.joint.joint`."""

from actuators.block import dtype
from fdi import registry
from fdi.joint import tables
from fdi.joint.places import AIRCRAFT, LANES, LOCAL, PLACES, SETS

NL, NP, NG, NC = len(LANES), len(PLACES), len(SETS), 10
NH, NR, NN, NA, NV = 128, 480, 33, 8, 6  # most hypotheses, rows, tokens; ages; sizes x variants
NQ = len(tables.PHASES)
NK, NCUL = 10, 24  # single hypotheses that a second one is tried with; culprits of a detector
# (lane, detector, output) of what tells more than a class; of one lane the first that says anything counts
FINER = [(i, d, output) for i, (d, lane) in enumerate(LANES) for output in registry.record(d).finer if lane != "second"]
LANE_OF = tuple(i for i, _, _ in FINER)
DETECTOR_OF = tuple((*LOCAL, *AIRCRAFT).index(d) for d, _ in LANES)
NF, NW, NV_F = len(FINER), 8, 16  # words of a detector, values of such an output

PARAMS = dtype([
    ("sure", "f8", "-"),  # probability from which a place is said
    ("sure_class", "f8", "-"),  # from which a class is
    ("two", "f8", "-"),  # prior of a second fault
    ("none", "f8", "-"),  # prior of no fault at all, over that of one
    ("keep", "f8", "s"),  # a token outlives its alarm by this
    ("release", "f8", "s"),  # without any alarm for so long it is over
    ("n_h", "f8"),  # hypotheses
    ("n_k", "f8"),
    ("row", "f8", (NH, NL)),  # of the tables below
    ("twin", "f8", (NH, NL)),  # 1 + the lane of the same detector on another segment that the hypothesis moves alike
    ("alike", "f8", "-"),  # how much twins have in common: 0 independent, 1 always the same
    ("prior", "f8", (NH,)),
    ("place", "f8", (NH,)),  # index into PLACES
    ("verdict", "f8", (NH,)),  # class code
    ("share", "f8", (NV,)),  # P(v)
    ("alarm", "f8", (NR, NV)),  # P(alarm | row, v)
    ("said", "f8", (NR, 2, NQ, NN)),  # P(token | alarm, row, variant, phase of the alarm)
    ("alarm_mean", "f8", (NR,)),  # the same over sizes and variants
    ("said_mean", "f8", (NR, NQ, NN)),  # P(alarm and token | row, phase)
    ("by_age", "f8", (NR, NA)),  # F
    ("false", "f8", (NL,)),  # P(false alarm with one name) of a lane
    ("alone", "f8", (NL, NQ)),  # odds of a fault where the lane's detector alone has spoken, by the phase of its alarm
    ("fall", "f8", "-"),  # P(a fault) below which an alarm that is there ends
    ("use", "f8", (NL,)),  # 1 where the lane is listened to
    ("token", "f8", (NL, NC, NCUL)),  # of class code and culprit
    ("finer", "f8", (NL, NC, NW)),  # of class code and word, 0 where the word adds nothing
    ("word", "f8", (NF, NV_F)),  # that an output's value is, 0 for none, -1 where it takes the last one back
    ("ages", "f8", (NA,), "s"),
    ("phases", "f8", (NQ,), "s"),
    ("set_of", "f8", (NG, NP)),  # 1 where the set has the place
    ("name_of", "f8", (NP,)),  # index into CULPRITS
    ("name_of_set", "f8", (NG,)),
])  # fmt: skip
WORDS = ("alarm", "verdict", "culprit", "valid")
INPUTS = dtype([*((n, "f8", (NL,), "-") for n in WORDS), ("finer", "f8", (NF,), "-")])
STATE = dtype([
    ("r", "f8", "-"),  # P(a fault) / (1/2)
    ("alarm", "f8", "-"),
    ("verdict", "f8", "-"),
    ("culprit", "f8", "-"),  # index into CULPRITS
    ("valid", "f8", "-"),
    ("p", "f8", "-"),  # probability that the culprit holds
    ("second", "f8", "-"),  # the other culprit where there are two faults, 0 where there is one
    ("verdict_2", "f8", "-"),
    ("p_2", "f8", "-"),
    ("p_fault", "f8", "-"),
    ("age", "f8", "s"),  # since the first witness, 0 without one
    ("still", "f8", "s"),  # since anything alarmed
    ("voices", "f8"),  # most detectors that have spoken at once since the first witness
    ("newest", "f8", "s"),  # age at which anything was new
    ("bin", "f8"),  # index of the age, and of that since anything was new
    ("bin_2", "f8"),
    ("said", "f8", (NL,)),  # token of each lane, 0 silent
    ("since", "f8", (NL,), "s"),  # age at which it came
    ("phase", "f8", (NL,)),  # of its alarm: index of `phases`
    ("over", "f8", (NL,), "s"),  # time for which the alarm behind it has been down
    ("able", "f8", (NL,)),  # whether it is valid
    ("word", "f8", (NL,)),  # that it said last of what its class leaves open
    ("w", "f8", (NH,)),  # of single hypotheses
    ("best", "f8", (NK,)),  # the largest of these
    ("place_w", "f8", (NP,)),  # of places: single, then first of two
    ("class_w", "f8", (NC,)),
    ("other_w", "f8", (NH,)),  # of the second of two
])  # fmt: skip
