"""Thresholds of detectors that fit a recording: one factor for each detector, at a false-alarm probability.

The largest |r| of every block of the first part of the recording has, in its upper fifth, an exponential tail
(cosim/training/threshold_fit.py): what it exceeds with PROBABILITY per 60 s is the factor on every threshold of the
detector. The detector then runs again with them, and its alarms in the part that was held back are counted against what
is expected.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.stats import poisson

from cosim.judge.alarms import onsets
from cosim.replay.detector_replay import output_names
from cosim.replay.map import Prepared, run_all
from cosim.training.threshold_fit import PROBABILITY, exceeded

LEARN = 0.6  # share of the recording that is learned from
BLOCK_S, FEWEST = 2.0, 12  # length of a block, and how many there have to be
PASSES = 4
LEAST = 1.0  # one recording is less than the flights of the training: no threshold goes below the shipped one
SURE = 0.05  # less probable counts of alarms contradict the stated probability


@dataclass
class Fitted:
    """What became of one detector: its factor, the parameters for `[detectors.ID]`, the check on what was held back."""

    id: str
    factor: float = 1.0
    parameters: dict[str, Any] = field(default_factory=dict)
    held_back_s: float = 0.0
    alarms: int = 0
    expected: float = 0.0
    agrees: bool = True
    note: str = ""


def names(module: Any) -> list[str]:
    """Return the thresholds among a detector's parameters."""
    return [n for n in module.PARAMS.names if n == "threshold" or n.endswith("_threshold") or n.startswith("th_")]


def _scaled(start, factor):
    out = {}
    for name, value in start.items():
        for at in np.ndindex(np.shape(value)):
            element = f"{name}[{','.join(map(str, at))}]" if at else name
            out[element] = float(f"{float(np.asarray(value)[at]) * factor:.4g}")
    return out


def fit(prepared: Prepared) -> list[Fitted]:
    """Return a Fitted for each detector whose inputs the map gives."""
    done, _ = run_all(prepared, {})
    return [_one(prepared, d) for d in {d.id: d for d, *_ in done}.values()]


def _one(prepared, d):
    own, out = names(d.module), Fitted(d.id)
    end = round(LEARN * prepared.n)
    largest, _, _ = _run(prepared, d, {}, end)
    if len(largest) < FEWEST:
        out.note = f"too short, or seldom valid: {len(largest)} blocks of {BLOCK_S:g} s, {FEWEST} are needed"
        return out
    if not own:
        out.note = "no parameter of it is a threshold by name"
        return out
    start = {n: prepared.params(d)[n][0] for n in own}
    for _ in range(PASSES):
        step = exceeded(largest, PROBABILITY * BLOCK_S / 60.0)
        factor = max(LEAST, out.factor * max(step, 1e-3))
        if abs(factor / out.factor - 1.0) < 0.05:
            break
        out.factor = factor
        out.parameters = _scaled(start, factor)
        largest, _, _ = _run(prepared, d, out.parameters, end)
    learned, alarms, seconds = _run(prepared, d, out.parameters, end)
    out.alarms, out.held_back_s = alarms, seconds
    out.expected = PROBABILITY * seconds / 60.0
    out.agrees = not alarms or float(poisson.sf(alarms - 1, out.expected)) > SURE
    if len(learned) and learned.max() > 1.0:
        out.note = "still exceeds its thresholds where they were learned: its model does not fit this recording"
        out.agrees = False
    elif not out.agrees:
        out.note = "alarms in the held-back part more often than stated: the recording's parts differ"
    return out


def _run(prepared, d, changed, end):
    """Return (largest |r| of each block before tick `end`, alarms after it, valid seconds after it), all lanes."""
    done, _ = run_all(prepared, {d.id: changed} if changed else {}, only=d.id)
    largest, alarms, seconds = [], 0, 0.0
    for own, _, _, again in done:
        at = output_names(own)
        r, valid = np.abs(again[:, at.index("r")]), again[:, at.index("valid")] > 0.5
        size, cut = round(BLOCK_S / prepared.dt / own.every), end // own.every
        blocks = [slice(a, a + size) for a in range(size, cut - size + 1, size)]
        largest += [float(np.nanmax(r[b])) for b in blocks if valid[b].mean() > 0.5 and np.isfinite(r[b]).any()]
        alarm = again[:, at.index("alarm")]
        alarms += int(np.sum(np.asarray(onsets(alarm)) >= cut))
        alarms += int(alarm[cut] > 0.5 and alarm[cut - 1] > 0.5)
        seconds += float(valid[cut:].sum()) * prepared.dt * own.every
    return np.array(largest), alarms, seconds
