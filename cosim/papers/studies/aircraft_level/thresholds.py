"""Thresholds of the two Sun13 estimators: trained, stored, judged on flights that training never saw."""

import math

from cosim.papers.studies.aircraft_level.table import Table
from cosim.training import train_rfafe
from fdi.common import bank
from fdi.common.tuning import thresholds

DEG = math.pi / 180.0


def run(*, out=None, workers=2, progress=None, train=True):
    """Return the tables: thresholds over frequency, and alarms on the evaluation flights.

    With `train` the training set is flown and the thresholds are stored first; the judgement is of what is stored.
    """
    if train:
        train_rfafe.retrain(out=None if out is None else out / "training.jsonl", workers=workers, progress=progress)
    names = list(train_rfafe.MODULES)
    held = {name: thresholds(name) for name in names}
    rows = [(float(hz), *(held[n]["bank_threshold"][k] / DEG for n in names))
            for k, hz in enumerate(bank.frequencies())]  # fmt: skip
    rows.append(("slow part", *(held[n]["th_static"] / DEG for n in names)))
    first = Table("thresholds of f_hat, command at rest [deg]", ("Hz", *names), rows)
    judged = train_rfafe.collect(train_rfafe.EVALUATION, out=None if out is None else out / "evaluation.jsonl",
                                 workers=workers, progress=progress)  # fmt: skip
    rows = [(n, len(judged), len(train_rfafe.alarms(judged, n))) for n in names]
    head = ("estimator", "flights", "alarmed")
    return [first, Table("fault-free flights of 60 s that training never saw", head, rows)]
