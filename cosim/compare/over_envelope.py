"""Where in the envelope detectors can judge and what they see there, from the flights of a campaign.

Mass, CG, altitude and speed are cut into PARTS of equally many flights each. For every detector and family of faults
that it is designed for there is a row per axis and part: faults, those seen, and how much of the flight it was valid.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from cosim.compare import rows as compare_rows
from cosim.judge.coverage import DESIGNED
from cosim.table import Column, Table, of, share
from cosim.texts import toml

AXES = {"mass_t": "t", "cg_pct": "%", "altitude_ft": "ft", "cas_kt": "kt CAS"}
PARTS = 3
ALIKE = 0.005  # shares of a flight that are printed alike


def over_envelope(frame: pd.DataFrame, tomls: Mapping[str, str], place: str = "") -> pd.DataFrame:
    """Return a row per detector, family, axis and part of it: id, family, axis, low, high (of the flights in it, units
    of AXES), faults, seen, valid_share (mean, 0 to 1).

    `frame` are a campaign's rows, `tomls` {run: scenario}. Empty where no detector is designed for a fault of them.
    Raises CampaignError at `place` for a row that no flight has.
    """
    rows = compare_rows.tidy(frame, tomls, place)
    rows = rows[rows["word"].eq(DESIGNED) & rows["concerned"]] if len(rows) else rows
    if rows.empty:
        return pd.DataFrame()
    points = {run: toml(tomls[run], place="scenario").get("flight", {}) for run in rows["run"].unique()}
    out = []
    for axis in AXES:
        at = rows["run"].map({run: point.get(axis, np.nan) for run, point in points.items()})
        flights = at.groupby(rows["run"]).first().dropna()
        edges = np.unique(np.quantile(flights, np.linspace(0.0, 1.0, PARTS + 1))) if len(flights) else np.zeros(0)
        part = pd.Series(np.searchsorted(edges[1:-1], at, side="right"), rows.index).where(at.notna(), -1)
        for (name, family, k), own in rows.groupby(["id", "family", part], sort=False):
            if k >= 0:
                here = at[own.index]
                out.append({"id": name, "family": family, "axis": axis, "low": here.min(), "high": here.max(),
                            "faults": len(own), "seen": int(own["detected"].sum()),
                            "valid_share": float(own["valid_share"].mean())})  # fmt: skip
    return pd.DataFrame(out)


def weakest(found: pd.DataFrame) -> Table:
    """Return the Table of a detector's and family's part of the envelope where it sees the smallest share; no part
    where all do alike."""

    def row(own: pd.DataFrame) -> dict[str, Any]:
        whole = own[own["axis"] == own["axis"].iloc[0]]
        seen = own["seen"] / own["faults"]
        names = {"id": own["id"].iloc[0], "family": own["family"].iloc[0]}
        return {**names, "all_faults": whole["faults"].sum(), "all_seen": whole["seen"].sum(),
                "least": own.loc[seen.idxmin()] if np.ptp(seen) else None, "valid_share": own["valid_share"].min(),
                "dull": own.loc[own["valid_share"].idxmin()] if np.ptp(own["valid_share"]) > ALIKE else None}

    def span(part: Any) -> str:
        return "" if part is None else f"{part['low']:,.0f} to {part['high']:,.0f} {AXES[part['axis']]}"

    columns = (
        Column("detector", "id", right=False), Column("faults", "family", right=False),
        Column("seen", lambda r: f"{r['all_seen']}/{r['all_faults']}"),
        Column("least", lambda r: "" if r["least"] is None else f"{r['least']['seen']}/{r['least']['faults']}"),
        Column("at", lambda r: span(r["least"]), right=False),
        Column("valid", lambda r: share(r["valid_share"]), doc="share of the flight, where it is least"),
        Column("there", lambda r: span(r["dull"]), right=False),
    )  # fmt: skip
    order = {name: i for i, name in enumerate(compare_rows.FAMILIES)}
    kinds = [row(own) for _, own in found.groupby(["id", "family"], sort=False)]
    kinds.sort(key=lambda r: order.get(r["family"], len(order)))
    return of(columns, kinds, caption="The whole of it, per axis, stands in the table.")
