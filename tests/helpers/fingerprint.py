"""Text fingerprint of a log: a few lines about its numbers, so that a change of them shows in review."""

import hashlib
import math
from typing import Any

import numpy as np


def fingerprint(log: Any) -> str:
    """Return text: per topic its rows and the SHA-256 of its values, per field first, last, least, greatest and mean.

    Topics that are not logged at every tick, such as a detector's whole states, have their one line only.

    Ten significant digits; the mean is summed exactly (fsum), so the text depends on the numbers only, not on the
    processor. `nan` counts the values that are not finite, which the other figures leave out.
    """
    lines = [f"ticks {log.n_ticks}  dt_ns {log.dt_ns}  complete {str(log.complete).lower()}"]
    for name, topic in log.topics.items():
        values = log.array(name)
        lines.append(f"{name}  rows {topic.rows}  every {topic.every}  sha256 {hashlib.sha256(values).hexdigest()}")
        if topic.every > 1:
            continue
        lines += [f"  {field}  {_figures(values[:, i])}" for i, field in enumerate(topic.fields)]
    return "\n".join(lines) + "\n"


def _figures(column):
    good = column[np.isfinite(column)]
    bad = f"  nan {column.size - good.size}" if good.size < column.size else ""
    if not good.size:
        return "empty" + bad
    if (good == good[0]).all():
        return f"constant {good[0]:.10g}{bad}"
    figures = good[0], good[-1], good.min(), good.max(), math.fsum(good) / good.size
    return "first {:.10g} last {:.10g} min {:.10g} max {:.10g} mean {:.10g}".format(*figures) + bad
