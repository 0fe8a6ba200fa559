"""Still pictures of the papers' figures: what is drawn stands where its axes say."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from cosim.papers.drawing import Curve, Drawing, Panel
from cosim.report.reproduce_page import write_pictures

NS = "{http://www.w3.org/2000/svg}"


def drawing(**more):
    t = np.arange(1000) * 0.01
    y = np.where(t < 5.0, 0.0, 2.0)
    y[200:260] = np.nan
    curves = (Curve("ours & theirs", y, dt=0.01), Curve("true", -y, "true", "dot", dt=0.01))
    panel = Panel("rod", "mm", curves, (1.0,), limits=(-4.0, 4.0))
    return Drawing("lu17", "figure 3", "A < B", "", (panel, panel), 2, onset=5.0, span=(0.0, 10.0), **more)


def test_a_curve_stands_where_its_axes_say_and_breaks_where_nothing_is_known(tmp_path):
    [path] = write_pictures(tmp_path, [drawing(picture="in-flight")])
    root = ElementTree.parse(path).getroot()
    lines = [p.get("d") for g in root.iter(f"{NS}g") for p in g]
    assert len(lines) == 2 * 2 and all(line.count("M") == 2 for line in lines)  # two panels of two curves, each a gap
    ticks = {t.text: float(t.get("y")) - 4 for t in root.iter(f"{NS}text") if t.get("text-anchor") == "end"}
    at = [float(v) for v in re.match(r"M([\d.]+) ([\d.]+)", lines[0]).groups()]
    assert at[1] == pytest.approx(ticks["0"], abs=0.2)  # begins at 0 mm
    steps = re.findall(r"l?(-?\d*\.?\d+)[ ]?(-?\d*\.?\d+)", lines[0].split("M")[2])
    end = float(steps[0][1]) + sum(float(dy) for _, dy in steps[1:])
    assert end == pytest.approx(ticks["2"], abs=0.3)  # and ends at 2 mm
    words = [t.text for t in root.iter(f"{NS}text")]
    assert {"A < B", "ours & theirs", "rod", "mm"} <= set(words) and words.count("time, s") == 2
    assert "var(" not in path.read_text(encoding="utf-8")  # it stands alone


def test_only_what_has_a_name_is_written(tmp_path):
    [path] = write_pictures(tmp_path, [drawing(), drawing(picture="in-flight")])
    assert path == tmp_path / "lu17" / "in-flight.svg" and re.match("<svg", path.read_text(encoding="utf-8"))
    assert len(list((tmp_path / "lu17").iterdir())) == 1


def test_each_figure_over_time_says_in_one_sentence_what_to_look_at():
    """Of the bench of Jay, whose figures need no flight."""
    from cosim.papers.jay import figures

    drawn = [figures._drawing(n) for n in figures.SHOWN]
    assert [d.beside for d in drawn] == [f"figure {n}" for n in range(3, 14)]
    assert all(d.look.endswith(".") and d.look.count(". ") == 0 for d in drawn)
    assert all(p.unit or p.title == "innovation mean" for d in drawn for p in d.panels)
