"""Splits that do not leak: by flight point, and by family of faults."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence

SHARES = ("train", "test", "train", "validation", "train")  # of every five points, in the order of their digests
NEEDED = 4  # points, from which on no share is empty
FOLDS = 5


def splits(rows: Sequence[Mapping[str, str]]) -> list[dict[str, object]]:
    """Return {split_point, fold_family} of flights that have a `point`, a `family` and a `run`.

    split_point: all flights of a point are in one of train, validation, test. fold_family, 0 to 4: a family stands in
    one fold, so that a model may be asked for faults that it never saw; flights without a fault are dealt out.
    """
    share = _dealt({r["point"] for r in rows}, len(SHARES))
    fold = _dealt({r["family"] for r in rows} - {"none"}, FOLDS)
    quiet = _dealt({r["run"] for r in rows if r["family"] == "none"}, FOLDS)
    return [
        {"split_point": SHARES[share[r["point"]]], "fold_family": quiet.get(r["run"], fold.get(r["family"], 0))}
        for r in rows
    ]


def empty(rows: Sequence[Mapping[str, object]]) -> list[str]:
    """Return a line for each kind of split that leaves a part of it without a flight: why, and what to do.

    `rows` have `point`, `family`, `split_point` and `fold_family`.
    """
    told = []
    shares = [name for name in dict.fromkeys(SHARES) if name not in {r["split_point"] for r in rows}]
    if shares:
        points = len({r["point"] for r in rows})
        told.append(
            f"split_point: no flight in {' and '.join(shares)}, as all flights of a point are in one split and the "
            f"campaign has {points} of {NEEDED} points. Vary flight.altitude_ft, flight.cas_kt or flight.mass_t in "
            "[grid] or [draw], or split by fold_family"
        )
    folds = [str(k) for k in range(FOLDS) if k not in {r["fold_family"] for r in rows}]
    if folds:
        families = len({r["family"] for r in rows} - {"none"})
        told.append(
            f"fold_family: no flight in fold {', '.join(folds)}, as a family of faults is in one fold and the campaign "
            f"has {families} of {FOLDS} families. Vary faults in [grid], or use the other folds alone"
        )
    return told


def _dealt(names: Iterable[str], hands: int) -> dict[str, int]:
    """Return {name: number below `hands`}, dealt in the order of the names' digests."""
    order = sorted(names, key=lambda name: hashlib.sha256(name.encode()).hexdigest())
    return {name: i % hands for i, name in enumerate(order)}
