"""Numbers kept on disk: found again by what they depend on, worked out anew where anything of it differs."""

import numpy as np
import pytest

from actuators import disk_cache as kept_module
from actuators.disk_cache import kept


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """Return the list of what was worked out; what is kept lies in a folder of the test's own."""
    monkeypatch.setattr(kept_module, "private_folder", lambda name: tmp_path)
    return []


def ask(calls, key):
    def make():
        calls.append(key)
        return np.array([0.1, np.nan, -0.0]) * (2 if key == "b" else 1)

    return kept(key, float, make, __file__)


def test_what_was_worked_out_is_found_again_bit_for_bit(calls):
    first, again, other = ask(calls, "a"), ask(calls, "a"), ask(calls, "b")
    assert first.tobytes() == again.tobytes() and first.tobytes() != other.tobytes() and calls == ["a", "b"]
    again[0] = 9.0  # nobody else's
    assert ask(calls, "a")[0] == 0.1


@pytest.mark.parametrize("spoil", [lambda d: d[:-1], lambda d: d[:40] + b"\1" + d[41:], lambda d: b""])
def test_a_spoiled_file_is_worked_out_anew(calls, tmp_path, spoil):
    ask(calls, "a")
    (file,) = tmp_path.glob("*.kept")
    file.write_bytes(spoil(file.read_bytes()))
    assert ask(calls, "a")[0] == 0.1 and calls == ["a", "a"]


def test_another_version_is_another_key(calls, monkeypatch):
    ask(calls, "a")
    monkeypatch.setattr(kept_module, "_machine", lambda: "other")
    ask(calls, "a")
    monkeypatch.setattr(kept_module, "private_folder", lambda name: None)
    assert ask(calls, "a")[0] == 0.1 and calls == ["a", "a", "a"]  # nowhere to keep it


def test_a_study_over_many_points_leaves_no_more_than_a_start_needs(calls, tmp_path, monkeypatch):
    monkeypatch.setattr(kept_module, "MOST", 3)
    for key in range(10):
        ask(calls, key)
    assert len(list(tmp_path.glob("*.kept"))) == 3 and len(calls) == 10
