"""The files that `cosim new detector NAME` writes."""

import re
from importlib import resources

from cosim.flight.plugins.contract import GuestError
from fdi import registry


def texts(name: str) -> dict[str, str]:
    """Return {file: text} of a detector `name` and its test. Raises GuestError for a name that cannot be its id."""
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or name == "enabled" or name in registry.SHIPPED:
        taken = "is a detector that ships" if name in registry.SHIPPED else "cannot be the id of a detector"
        raise GuestError(taken, place=name, allowed="lower-case letters, digits and _")
    words = {"CLASS": "".join(part.capitalize() for part in name.split("_")), "NAME": name}
    folder = resources.files("cosim").joinpath("templates")
    out = {}
    for template, file in (("detector.py", f"{name}.py"), ("test_detector.py", f"test_{name}.py")):
        text = folder.joinpath(template).read_text(encoding="utf-8")
        for word, own in words.items():
            text = text.replace(word, own)
        out[file] = text
    return out
