"""Figures of the papers: each says what to look at."""


def test_each_figure_over_time_says_in_one_sentence_what_to_look_at():
    """Of the bench of Jay, whose figures need no flight."""
    from cosim.papers.jay import figures

    drawn = [figures._drawing(n) for n in figures.SHOWN]
    assert [d.beside for d in drawn] == [f"figure {n}" for n in range(3, 14)]
    assert all(d.look.endswith(".") and d.look.count(". ") == 0 for d in drawn)
    assert all(p.unit or p.title == "innovation mean" for d in drawn for p in d.panels)
