"""What the aircraft-level detectors can and cannot do, in numbers: `python -m cosim.papers.studies.aircraft_level
PART`.

Each part flies what it needs and prints its tables; long ones keep what is done in a folder and go on from there.
"""

import importlib

PARTS = {
    "noise": "rfafe, rfafe_airframe: fault-free noise predicted through the loop and flown",
    "lpv": "the affine LPV model on its second grid, beside what any affine model could do",
    "uncertain": "lpv_smo: what wrong coefficients do to the elevator estimate, one by one and in draws",
    "ofc": "all: oscillations of one elevator segment seen within three periods, over frequency and amplitude",
    "corners": "all: the same faults at the design point and at corners of the envelope",
    "redundancy": "control_redundancy: the three scenarios in draws, confusion matrix, extra declarations",
    "smallest": "control_redundancy: the smallest lock offset and thrust loss found per effector",
    "thresholds": "rfafe, rfafe_airframe: train the thresholds, store them, judge them",
}


def run(part, **options):
    """Return the Tables of `part`; options are out (folder or None), workers, progress(done, total), and the part's
    own. Raises KeyError for no part.
    """
    if part not in PARTS:
        raise KeyError(f"{part!r} is no part; there is {', '.join(PARTS)}")
    return importlib.import_module(f"{__name__}.{part}").run(**options)
