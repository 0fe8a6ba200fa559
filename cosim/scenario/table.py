"""What every table of a scenario has in common."""

from collections.abc import Iterable

from pydantic import BaseModel, ConfigDict

from cosim.errors import did_you_mean
from cosim.scenario.catalog import Key
from cosim.scenario.problem import problem

MULTIPLIER = Key("multiplier", 0.2, 5.0)


class Table(BaseModel):
    """A frozen table of a scenario: unknown keys, wrong types and numbers that are not finite are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def known_keys(table: Iterable[str], known: Iterable[str], path: str = "") -> None:
    """Raise for a key of `table` that is not `known`; `path` stands before it in what is said."""
    known = tuple(known)
    for key in table:
        if key not in known:
            raise problem("unknown key", key=f"{path}{key}", allowed=", ".join(known), remedy=did_you_mean(key, known))
