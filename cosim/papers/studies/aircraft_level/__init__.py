"""What the aircraft-level detectors can and cannot do, in numbers: `cosim study aircraft_level`.

Oscillations over frequency and amplitude, seen within three periods, are the campaign `aircraft-vs-local` and
`cosim compare`; noise predicted and flown are rows of `cosim reproduce sun13`, declarations in draws of `mar10`.
"""

from typing import Any

ABOUT = "What the aircraft-level detectors can and cannot do, in numbers."


def questions() -> list[Any]:
    """Return the Questions of the study."""
    from cosim.papers.studies import Question
    from cosim.papers.studies.aircraft_level import bound, corners, envelope, lpv, smallest, thresholds, uncertain

    return [
        Question("lpv", "the affine LPV model on its second grid, beside what any affine model could do (20 s)",
                 lpv.jobs, lpv.tables),
        Question("bound", "least oscillation that shows in the pitch rate, known aircraft, still air (5 s)", bound.jobs,
                 bound.tables),
        Question("uncertain", "lpv_smo: what wrong coefficients do to the elevator estimate (5 min)", uncertain.jobs,
                 uncertain.tables, 20),
        Question("corners", "all: the same faults at the design point and at corners of the envelope (5 min)",
                 corners.jobs, corners.tables, 2),
        Question("envelope", "all but rfafe, over the envelope: points and seeds that training never saw (15 min)",
                 envelope.jobs, envelope.tables, 16),
        Question("smallest", "control_redundancy: smallest lock and thrust loss found per effector (25 min)",
                 smallest.jobs, smallest.tables, 10),
        Question("thresholds", "rfafe, rfafe_airframe: alarms in flights that training never saw (5 min)",
                 thresholds.jobs, thresholds.tables),
    ]  # fmt: skip
