"""What the tests of user detectors share."""

import pytest

from cosim.flight.new import texts


@pytest.fixture(scope="module")
def parity(tmp_path_factory):
    """Return the file that `cosim new detector parity` writes."""
    folder = tmp_path_factory.mktemp("user_detectors")
    for name, text in texts("parity").items():
        (folder / name).write_text(text)
    return folder / "parity.py"
