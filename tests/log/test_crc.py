"""Checksums of large blocks are zlib's, whatever folds them."""

import itertools
import zlib

import numpy as np
import pytest

from cosim.log import crc

DATA = np.random.default_rng(7).integers(0, 256, crc.LEAST + 3 * crc.BLOCK, "u1")
SIZES = [*range(crc.LEAST - 1, crc.LEAST + crc.BLOCK + 1, 17), crc.LEAST + crc.BLOCK, len(DATA)]


@pytest.fixture
def folding(monkeypatch):
    """Count the calls of the compiled function."""
    if not crc.foldable():
        pytest.skip("this processor does not multiply without carries, or nothing is compiled")
    assert crc.FOLD.address  # a checksum does not wait for it
    free, called = crc.FOLD.free, []
    monkeypatch.setattr(crc.FOLD, "free", lambda *args: called.append(free(*args)))
    return called


def test_a_folded_checksum_is_zlibs_for_every_size_start_and_number_before(folding):
    for size, start, before in itertools.product(SIZES, (0, 3), (0, 1, 0xFFFFFFFF, 0x12345678)):
        part = DATA[start : start + size]
        assert crc.crc32(part, before) == crc.crc32(part.tobytes(), before) == zlib.crc32(part, before)
    assert len(folding) >= 8 * (len(SIZES) - 1)


def test_one_bit_changes_it_and_parts_give_the_whole(folding):
    whole = crc.crc32(DATA)
    for bit in (0, 8 * crc.LEAST - 1, 8 * len(DATA) - 1):
        changed = DATA.copy()
        changed[bit // 8] ^= 1 << bit % 8
        assert crc.crc32(changed) != whole
    twice = np.concatenate([DATA, DATA])
    assert crc.crc32(DATA, whole) == zlib.crc32(twice) == crc.crc32(twice)


def test_a_processor_without_wide_registers_finds_the_same(folding, monkeypatch):
    from actuators.object_cache import of_wholes
    from cosim.log import crc_kernel as kernel

    for name, value in (("WIDE", False), ("LANES", 1), ("STRIDE", 16 * kernel.SUMS)):
        monkeypatch.setattr(kernel, name, value)
    monkeypatch.setattr(kernel, "_REGISTER", kernel.ir.VectorType(kernel.ir.IntType(64), 2))
    narrow = of_wholes("cosim.log.crc_kernel", "fold", 4, "")
    monkeypatch.setattr(narrow, "_file", lambda: None)  # it is not kept
    monkeypatch.setattr(crc, "FOLD", narrow)
    assert narrow.address
    for size in SIZES[1:]:
        assert crc.crc32(DATA[:size]) == zlib.crc32(DATA[:size])


def test_what_is_not_compiled_yet_is_left_to_zlib(monkeypatch):
    monkeypatch.setattr(crc, "FOLD", type("Missing", (), {"ready": lambda self: False})())
    assert crc.crc32(DATA, 5) == zlib.crc32(DATA, 5)
