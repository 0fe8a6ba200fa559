"""One way to say what is wrong with a value: pydantic carries it, `load` turns it into a ScenarioError."""

from collections.abc import Iterable
from typing import Any

from pydantic_core import PydanticCustomError

from cosim.errors import did_you_mean


def problem(text: str, *, key: str = "", allowed: str = "", remedy: str = "") -> PydanticCustomError:
    """Return the exception a validator raises; `key` is the path below the validated table."""
    return PydanticCustomError("cosim", "{text}", {"text": text, "key": key, "allowed": allowed, "remedy": remedy})


def choice(value: Any, choices: Iterable[str], what: str, *, key: str = "") -> PydanticCustomError:
    """Return the exception for a word that is not one of `choices`."""
    return problem(f"{value!r} is no {what}", key=key, allowed=", ".join(choices), remedy=did_you_mean(value, choices))
