"""Still pictures of the papers' figures: what is drawn stands where its axes say."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from cosim.papers.drawing import Curve, Drawing, Panel
from cosim.report import papers_picture as picture

NS = "{http://www.w3.org/2000/svg}"


def drawing(**more):
    t = np.arange(1000) * 0.01
    y = np.where(t < 5.0, 0.0, 2.0)
    y[200:260] = np.nan
    curves = (Curve("ours & theirs", y, dt=0.01), Curve("true", -y, "true", "dot", dt=0.01))
    panel = Panel("rod", "mm", curves, (1.0,), limits=(-4.0, 4.0))
    return Drawing("lu17", "figure 3", "A < B", "", (panel, panel), 2, onset=5.0, span=(0.0, 10.0), **more)


def test_a_curve_stands_where_its_axes_say_and_breaks_where_nothing_is_known():
    svg = ElementTree.fromstring(picture.render(drawing()))
    lines = [line.get("points") for line in svg.iter(f"{NS}polyline")]
    assert len(lines) == 2 * 2 * 2  # two panels of two curves, each with a gap
    x, y = map(float, lines[1].split()[-1].split(","))  # at 10 s, 2 mm of -4 .. 4
    assert x == pytest.approx(picture.LEFT + picture.WIDE, abs=3.0)
    assert y == pytest.approx(picture.TOP + picture.HIGH / 4, abs=0.2)
    words = [t.text for t in svg.iter(f"{NS}text")]
    assert "A < B" in words and "ours & theirs" in words and "rod, mm" in words and words.count("time, s") == 2


def test_ticks_are_round_and_within():
    for low, high in ((-4.0, 4.0), (0.0, 0.013), (-1750.0, 12.0), (8.0, 25.0)):
        ticks = picture._ticks(low, high)
        assert 3 <= len(ticks) <= 8 and low <= ticks[0] and ticks[-1] <= high
        assert len({f"{np.diff(ticks)[i]:.6g}" for i in range(len(ticks) - 1)}) == 1


def test_only_what_has_a_name_is_written(tmp_path):
    (tmp_path / "lu17").mkdir()
    [path] = picture.write(tmp_path, [drawing(), drawing(picture="in-flight")])
    assert path == tmp_path / "lu17" / "in-flight.svg" and re.match("<svg", path.read_text(encoding="utf-8"))
    assert len(list((tmp_path / "lu17").iterdir())) == 1


def test_each_figure_over_time_says_in_one_sentence_what_to_look_at(monkeypatch):
    """Of the bench of Jay, whose figures need no flight."""
    from cosim.papers.jay import figures

    monkeypatch.setattr(figures, "_in_flight", lambda: [])
    drawn = figures.drawings()[:-1]
    assert [d.beside for d in drawn] == [f"figure {n}" for n in range(3, 14)]
    assert all(d.look.endswith(".") and d.look.count(". ") == 0 for d in drawn)
    assert all(p.unit or p.title == "innovation mean" for d in drawn for p in d.panels)
