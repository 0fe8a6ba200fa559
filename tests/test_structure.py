"""How the source is built: what tests/structure.py counts keeps within its bounds."""

import structure


def test_rooms_are_few_and_imports_run_downwards():
    found = structure.counts()
    assert found["rooms of cosim"] <= 12 and found["loose modules of cosim"] <= 8
    assert found["floors"] <= 12


def test_every_public_function_says_what_it_does():
    assert structure.undocumented() == []
