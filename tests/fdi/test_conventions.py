"""What every detector says in the same way: reasons for not judging, alarms of several parts at once."""

import pytest

from fdi import registry
from fdi.common import verdict, why


def test_reasons_have_words_and_nothing_else_has():
    codes = [v for k, v in vars(why).items() if isinstance(v, float)]
    assert sorted(codes) == list(range(len(why.WORDS)))
    assert why.words(why.BOX_MASS) == "outside its box (mass)"
    for wrong in (-1.0, 0.5, float(len(why.WORDS))):
        with pytest.raises(ValueError, match="no reason"):
            why.words(wrong)


def test_parts_that_are_declared_on_their_own():
    assert verdict.alarm_fields(("", "n_z", "alpha"), ("r", "alarm_n_z")) == {"n_z": "alarm_n_z"}
    assert verdict.alarm_fields(("", "elevator"), ("alarm", "culprit")) == {}


@pytest.mark.parametrize("name", registry.SHIPPED)
def test_every_value_of_a_state_has_a_name_of_its_own_in_a_log(name):
    kind, names = registry.module(name).STATE, []
    for field in kind.names:
        n = kind[field].itemsize // 8
        names += [field] if n == 1 and not kind[field].shape else [f"{field}_{i}" for i in range(n)]
    assert len(set(names)) == len(names)
