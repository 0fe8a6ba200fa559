"""The central claim of [Sun13]: does decoupling E make the estimate robust? And what the learning rate trades.

E comes from six fault-free flights, from six in moderate gusts, or from six with coefficients 5 % off. In the published
form no gain stands on an airframe output; the airframe form is the one on which E can act.
"""

import functools
from collections.abc import Callable
from typing import Any

from cosim.papers.row import Of
from cosim.papers.sun13 import variants
from cosim.papers.sun13.flown import rms, six
from fdi.rfafe import rfafe, rfafe_airframe

WHY = (
    "the form on which E can act; what of E lies along F cannot be decoupled and stays, and what is left of each E is "
    "the plane of V and alpha"
)
BANDWIDTH = (10.0, 40.0, 160.0)  # of the loop, proportional to the learning rate: a quarter, ours, four times [rad/s]
FORMS = {"rfafe": (rfafe, variants.published), "rfafe_airframe": (rfafe_airframe, variants.airframe_with)}
WORDS = {"rfafe": "published form", "rfafe_airframe": "airframe outputs only"}


def _size(form: str, flights: list[Any], source: str) -> float:
    """Return the rms of f_hat [deg] over flights, E of one of SOURCES."""
    module, made = FORMS[form]
    return rms(flights, form, module.params(stored=made(source)))


@functools.cache
def _decoupled(form: str, source: str) -> tuple[float, str]:
    """Return rms of f_hat with coefficients 5 % off over six flights, E from `source` over no E; the same in gusts."""
    off, gusts = six("none", variants.WRONG), six("moderate")
    without = _size(form, off, "no E")
    ratio, gusty = _size(form, off, source) / without, _size(form, gusts, source) / _size(form, gusts, "no E")
    return ratio, f"of {without:.3f} deg; {gusty:.3f} in moderate turbulence"


def _decoupling(of):
    yield of.claim(
        "six fault-free flights, Cm_alpha +5 %, Cm_de -5 %: rms of f_hat over that with nominal coefficients",
        'section IV: "not significantly affected by the modelling uncertainties"; 20 % is ours',
        lambda: rms(six("none", variants.WRONG), "rfafe", None) / rms(six(), "rfafe", None),
        0.8,
        1.2,
    )
    for form in FORMS:
        for source in list(variants.SOURCES)[1:]:
            item = f"{WORDS[form]}, coefficients 5 % off: rms of f_hat with E of {source} over that without E"
            measure = functools.partial(_decoupled, form, source)
            if form == "rfafe" and source == "six flights":
                yield of.claim(
                    item,
                    'section I: "by making the output error [...] insensitive to modelling uncertainty the fault '
                    'estimation robustness is improved": below 0.9',
                    measure,
                    0.0,
                    0.9,
                    "the published form is a position monitor (row (17)): its gain has no entry on an airframe "
                    "output, so that no error of the airframe, decoupled or not, reaches f_hat",
                )
            else:
                own = "E of other flights" if form == "rfafe" else WHY
                yield of.ours(item, measure, 0.95, 1.05, says=f"not in the paper: {own}")


def _learning(of, published):
    @functools.cache
    def rate(bandwidth):
        stored = variants.published("six flights", bandwidth)
        return abs(published("ofc_liquid", 2.0, stored=stored)), stored["designs"]["hydraulic"]["noise_deg"][0]

    says = (
        'section IV: the learning rate "should be tuned to a suitable value to achieve accurate and fast fault '
        'estimation"'
    )
    yield of.claim(
        "learning rate a quarter of ours: |f_hat/f| at 2 Hz",
        says + ": too slow",
        lambda: rate(BANDWIDTH[0])[0],
        0.0,
        0.9,
    )
    yield of.claim(
        "learning rate four times ours: noise of f_hat over ours",
        says + '; "influenced by high frequency sensor noise": too noisy',
        lambda: rate(BANDWIDTH[2])[1] / rate(BANDWIDTH[1])[1],
        1.2,
        10.0,
    )


def plan(of: Of, published: Callable) -> list[Any]:
    """Return the Planned rows; `published(kind, hz, stored=)` is |f_hat/f| of the published form."""
    return [*_decoupling(of), *_learning(of, published)]
