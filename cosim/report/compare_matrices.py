"""Matrices of a comparison: fault by level, fault by detector, and what each detector called each fault."""

import pandas as pd

from cosim.compare import stats
from cosim.judge import coverage

SYMBOL = {
    "named": "●",
    "ambiguous": "◐",
    "misnamed": "≠",
    "missed": "✕",
    "quiet": "·",
    "bonus": "!",
    "idle": "–",
    "echo": "~",
}
CLASS = {
    "named": "c-seen",
    "ambiguous": "c-part",
    "misnamed": "c-part",
    "missed": "c-missed",
    "quiet": "c-quiet",
    "bonus": "c-bonus",
    "idle": "c-quiet",
    "echo": "c-bonus",
}


def levels(grouped: pd.DataFrame) -> dict | None:
    """Return {names, rows} of case x group: flights in which the group saw the fault, and how soon; None without."""
    if grouped.empty:
        return None
    names = list(dict.fromkeys(grouped["group"]))
    out = []
    for case, own in sorted(grouped.groupby("case", sort=False), key=lambda pair: _order(pair[0])):
        cells = []
        for g in names:
            part = own[own["group"] == g]
            seen, able = int(part["seen"].sum()), bool(part["able"].any())
            told = f"{seen}/{len(part)}" + (f", {part['delay_s'].min():.2f} s" if seen else "")
            look = "c-none" if not able else "c-seen" if seen == len(part) else "c-part" if seen else "c-missed"
            cells.append((look, ", ".join(sorted(set(part["first"].dropna()))), told if able else "blind"))
        out.append((coverage.label(case), cells))
    return {"names": names, "rows": out}


def _order(case):
    heads = ("hydraulic", "ema", "simple", "aileron", "rudder", "stabiliser", "engine", "sensor")
    head = case.split(".")[0]
    return heads.index(head) if head in heads else len(heads), case


KEY = (
    ("c-seen", "●", "seen and named right"),
    ("c-part", "◐", "seen, called ambiguous"),
    ("c-part", "≠", "seen under another name"),
    ("c-missed", "✕", "designed for it, and missed"),
    ("c-quiet", "·", "may see it, stayed quiet"),
    ("c-none", "", "blind by structure, and quiet"),
    ("c-bonus", "!", "alarm though blind: not of the fault itself"),
    ("c-bonus", "~", "alarm that the manoeuvre raises without a fault as well"),
    ("c-quiet", "–", "not valid: it could not judge"),
)


def matrix(rows: pd.DataFrame) -> dict | None:
    """Return {names, key, groups} of the coverage matrix: what was expected, what happened; None without a fault."""
    found = stats.coverage_matrix(rows)
    names = [n for group in stats.groups(rows).values() for n in group]
    if not found:
        return None
    groups: dict = {}
    for case in sorted(found, key=_order):
        head = coverage.label(case).split(":")[0] if "." in case else "other effectors"
        head = "aircraft sensors" if case.startswith("sensor") else head
        row = [_cell(n, found[case].get(n)) for n in names]
        groups.setdefault(head, []).append((coverage.label(case).split(": ")[-1], row))
    return {"names": names, "key": KEY, "groups": groups.items()}


def _cell(name, cell):
    """Return (class, title, words) of one detector and case."""
    if cell is None:
        return "", "", ""
    found = sorted(cell["outcomes"].items(), key=lambda pair: -pair[1])
    good, kinds = {"named"}, {o for o, _ in found}
    if cell["word"] == coverage.BLIND and kinds <= {"quiet", "idle"}:
        look, told = "c-none", ""
    elif len(found) == 1:
        outcome = found[0][0]
        look, told = (
            CLASS[outcome],
            f"{SYMBOL[outcome]} {cell['detected']}/{cell['runs']}"
            if outcome not in ("quiet", "idle")
            else SYMBOL[outcome],
        )
    else:
        part = kinds & {"named", "ambiguous", "misnamed"}
        look = "c-seen" if kinds <= good else "c-part" if part else CLASS[found[0][0]]
        told = " ".join(f"{SYMBOL[o]}{n}" for o, n in found)
    border = " designed" * (cell["word"] == coverage.DESIGNED and cell["lane"])
    more = f"{coverage.WORDS[cell['word']]}; " + ", ".join(f"{n} {o}" for o, n in found)
    return look + border, f"{name}: {more}", told


def confusions(rows: pd.DataFrame) -> list[dict]:
    """Return [{name, columns, rows, rest}]: one confusion matrix per detector."""
    out = []
    for name in dict.fromkeys(rows["id"]):
        counts = stats.confusion(rows, name)
        if counts.empty:
            continue
        telling = [
            c
            for c in counts.index
            if c == "no fault"
            or coverage.expected(name, c).word == coverage.DESIGNED
            or counts.loc[c].drop("none", errors="ignore").sum()
        ]
        rest, counts = len(counts) - len(telling), counts.loc[telling]
        counts = counts.loc[:, counts.sum() > 0]
        last = [c for c in ("ambiguous", "none", "false alarm") if c in counts.columns]
        columns = [c for c in counts.columns if c not in last] + last
        out.append({
            "name": name,
            "columns": [c.replace("_", " ") for c in columns],
            "rest": rest,
            "rows": [
                (case if case == "no fault" else coverage.label(case),
                 [(_shade(n := int(counts.loc[case, c]), c, case, name), "", n or "") for c in columns])
                for case in sorted(counts.index, key=lambda c: _order(c) if c != "no fault" else (99, ""))
            ],
        })  # fmt: skip
    return out


def _shade(count, said, case, name):
    if not count:
        return "c-none"
    if said == "none":
        return "c-missed" if coverage.expected(name, case).word == coverage.DESIGNED else "c-quiet"
    if said == "false alarm":
        return "c-missed"
    right = coverage.true_classes(case)
    return "c-seen" if said in right else "c-quiet" if said == "ambiguous" else "c-part"
