"""Thresholds of the two Sun13 estimators, and alarms on flights that training never saw (`cosim train rfafe`)."""

from typing import Any

from actuators.constants import RAD_PER_DEG
from cosim.papers.studies import Options
from cosim.training import train_rfafe
from fdi.common import bank
from fdi.common.tuning import thresholds


def jobs(options: Options) -> list[Any]:
    """Return the flights of the evaluation."""
    first = train_rfafe.EVALUATION
    return [(train_rfafe.look, {"first_seed": first, "index": i}) for i in range(len(list(train_rfafe.flights(first))))]


def tables(options: Options, values: Any) -> list[Any]:
    """Return the tables: thresholds over frequency, and alarms."""
    names = list(train_rfafe.MODULES)
    held = {name: thresholds(name) for name in names}
    rows = [(f"{hz:.3g}", *(held[n]["bank_threshold"][k] / RAD_PER_DEG for n in names))
            for k, hz in enumerate(bank.frequencies())]  # fmt: skip
    rows.append(("slow part", *(held[n]["th_static"] / RAD_PER_DEG for n in names)))
    alarmed = [(n, len(values), sum(v[n][3] > 0 for v in values)) for n in names]
    return [("thresholds of f_hat, command at rest [deg]", ("Hz", *(f"{n}>" for n in names)), rows),
            ("fault-free flights of 60 s that training never saw", ("estimator", "flights>", "alarmed>"), alarmed)]
