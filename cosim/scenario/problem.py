"""One way to say what is wrong with a value: pydantic carries it, `load` turns it into a ScenarioError."""

from pydantic_core import PydanticCustomError

from cosim.errors import did_you_mean


def problem(text, *, key="", allowed="", remedy=""):
    """Return the exception a validator raises; `key` is the path below the validated table."""
    return PydanticCustomError("cosim", "{text}", {"text": text, "key": key, "allowed": allowed, "remedy": remedy})


def choice(value, choices, what, *, key=""):
    """Return the exception for a word that is not one of `choices`."""
    return problem(f"{value!r} is no {what}", key=key, allowed=", ".join(choices), remedy=did_you_mean(value, choices))
