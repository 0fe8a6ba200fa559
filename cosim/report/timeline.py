"""All alarms of a flight on one time line, with the faults."""

import numpy as np

from cosim.judge.alarms import faulty
from cosim.judge.detection import name_at_end
from cosim.judge.result import concerns
from cosim.replay.recording import LoggedFlight, spans, words
from cosim.report.figure import POINTS, Figure, bands, base, points, style_axis
from fdi.common.verdict import class_name


def timeline(flown: LoggedFlight) -> tuple[Figure, list[dict], list[dict]]:
    """Return all alarms on one time line: a row per lane, thick where it alarms, pale where it cannot judge."""
    hollow, top = ("; hollow bars: false alarms", " The topmost bars: the faults.") if flown.knows_faults else ("", "")
    figure = Figure(
        "timeline",
        f"Thick bars: alarms, with the last name and when it first came, if later; of close ones the "
        f"longest is named{hollow}. Thin lines: the detector "
        f"watches and is quiet; gaps: its estimate is not valid.{top} Click a detector in the bar above to hide it.",
    )
    figure.layout = base(300, legend=False) | {"margin": {"l": 190, "r": 14, "t": 8, "b": 40}, "hovermode": "closest"}
    figure.layout["xaxis"] = style_axis("time, s", range=[flown.t0, flown.end])
    figure.layout["yaxis"] = style_axis("", type="category", ticklabelstandoff=4) | {
        "gridcolor": "rgba(0,0,0,0)",
        "tickfont": {"size": 11.5, "color": "--ink"},
    }
    bands(figure.layout, flown.intervals, 1)
    figure.rows, alarms, faults = [], [], []
    for f, told in zip(flown.scenario.faults, flown.faults):
        row, end = f"fault: {words(f.kind)}", min(told["end_s"], flown.end)
        if row not in [r["name"] for r in figure.rows]:
            figure.rows.append({"name": row, "detector": ""})
        _bar(figure, row, f.start_s, end, "--ink", 9, f"{words(f.kind)} on {words(f.target)}")
        faults.append({"from": f.start_s, "to": end, "text": f"{words(f.kind)} on {words(f.target)}"})
    for lane in flown.lanes:
        figure.rows.append({"name": lane.name, "detector": lane.id})
        alarms += _row(figure, flown, lane)
    figure.height = 22 * len(figure.rows) + 70
    figure.layout["height"] = figure.height
    return figure, alarms, faults


def _bar(figure, row, a, b, colour, width, told, who=None):
    line, hover = {"color": colour, "width": width}, f"{told}<br>%{{x:.3f}} s<extra></extra>"
    figure.data.append(points(1, mode="lines", x=[a, b], y=[row] * 2, line=line, name=told, detector=who, hover=hover))


def _row(figure, flown, lane):
    """Draw one lane; return its alarms for the cursor's line."""
    step, out = flown.dt * lane.every, []
    on, verdict, culprit = (lane.fields[n] for n in ("alarm", "verdict", "culprit"))
    for a, b in _joined(spans(lane.fields["valid"] > 0.5, flown.t0, step), (flown.end - flown.t0) / POINTS):
        _bar(figure, lane.name, a, b, "--line", 1.5, f"{lane.name}: watching", lane.id)
    real, labels = _real(flown, lane, step), []
    found = spans(on > 0.5, flown.t0, step)
    for a, b in found:
        k = slice(round((a - flown.t0) / step), round((b - flown.t0) / step))
        said = _said(lane, verdict[k], culprit[k], a, step)
        true = real[k.start] if k.start < len(real) else False
        out.append(
            {"from": a, "to": b, "text": f"{lane.name} ({said}{'' if true else ', false'})", "detector": lane.id}
        )
        told = f"{lane.name}: alarm {a:.3f} to {b:.3f} s, {said}{'' if true else ', false alarm'}"
        _bar(figure, lane.name, a, b, "--fault" if true else "--gold", 11, told, lane.id)
        if not true:  # hollow: also without colour it is another thing
            _bar(figure, lane.name, a, b, "--page", 5, told, lane.id)
        labels.append((a, b, said))
    _labels(figure, flown, lane, labels)
    return out


def _joined(found, gap):
    """Return [(from, to)] with those joined that are less than `gap` [s] apart: a drawing does not show it."""
    out: list = []
    for a, b in found:
        if out and a - out[-1][1] < gap:
            out[-1] = (out[-1][0], b)
        else:
            out.append((a, b))
    return out


def _said(lane, verdict, culprit, start, step):
    """Return the name at the end of an alarm that begins at `start` [s] and, where it came later, since when."""
    given = np.flatnonzero(verdict > 0.5)
    if not len(given):
        return "alarm, no name"
    end = name_at_end(verdict[given], culprit[given], given, given + 1, step)
    if end is None:
        return "alarm, names in turn"
    last = given[end]
    first = given[np.argmax((verdict[given] == verdict[last]) & (culprit[given] == culprit[last]))]
    blamed = culprit[last]
    part = lane.culprits[int(blamed)] if 0 <= blamed < len(lane.culprits) else ""
    since = f" from {start + first * step:.2f} s" if first else ""
    return f"{words(class_name(verdict[last]))} {words(part)}".strip() + since


def _labels(figure, flown, lane, alarms):
    """Write the verdict beside its bar, of bars without room between them that of the longest; at the left edge on the
    bar itself."""
    near: list[list] = []
    room = (flown.end - flown.t0) / 8
    for alarm in alarms:
        if near and alarm[0] - near[-1][0][0] < room:
            near[-1].append(alarm)
        else:
            near.append([alarm])
    for a, _, said in (max(own, key=lambda alarm: alarm[1] - alarm[0]) for own in near):
        inside = a - flown.t0 < room
        side = {"xanchor": "left", "xshift": 12} if inside else {"xanchor": "right", "xshift": -3}
        look = {"font": {"size": 11, "color": "--ink"}, "bgcolor": "--page", "borderpad": 1}  # watching runs behind it
        told = {"text": said, "x": a, "y": lane.name, "showarrow": False, "detector": lane.id}
        figure.layout["annotations"].append({**told, **side, **look})


def _real(flown, lane, step):
    """Return the rows (bool) at which an alarm of the lane would be a true one."""
    if not flown.knows_faults:
        return np.ones(len(lane.fields["alarm"]), bool)
    own = [f for f in flown.faults if concerns(lane, f["targets"])]
    return faulty(own, len(lane.fields["alarm"]), step, flown.t0)
