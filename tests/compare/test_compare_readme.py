"""What a comparison puts into the README: counts and picture follow from the rows, nothing else in the file changes."""

import os
import xml.etree.ElementTree as ElementTree

import pandas as pd
import pytest
from test_stats import hand_made
from typer.testing import CliRunner

from cosim.cli import commands as cli
from cosim.compare import Comparison, stats
from cosim.errors import OutputError
from cosim.report import compare_markdown as compare_readme
from cosim.report import markdown as readme
from cosim.report.compare_picture import render


@pytest.fixture
def found():
    rows = hand_made()
    return Comparison(rows, stats.detectors(rows), rows["run"].nunique(), 0, "hand made")


def test_table_and_picture_replace_what_stands_between_the_markers(found, tmp_path):
    begin, end = readme.markers("compare")
    path = tmp_path / "README.md"
    path.write_text(f"before\n{begin}\nold\n{end}\nafter\n")
    for _ in range(2):  # again gives the same
        compare_readme.write(found, path)
        text = path.read_text()
        assert text.startswith("before\n") and text.endswith("\nafter\n") and "old" not in text
        made = readme.part(text, "compare")
        assert "8 flights, 4 of them without a fault." in made
        assert "| `iotsekf` | 3 | 2 | 2 | 0 | 0 | 0 | 0.50 | 1.00 | 0 |" in made
        whole = "| `iotsekf` | actuator filters | 3 | 2 | 9% to 99% | 2 | 0 | 0 | 0 | 0 | 1 | 0.50 | 1.00 | 0 |"
        assert whole in compare_readme.markdown(found)
        assert len(made.splitlines()) < 16
        assert (tmp_path / compare_readme.PICTURE).is_file()


def test_what_each_level_sees_stands_apart(found, tmp_path):
    begin, end = readme.markers("compare")
    path, details = tmp_path / "README.md", tmp_path / compare_readme.DETAILS
    details.parent.mkdir(parents=True)
    path.write_text(f"{begin}\n{end}\n")
    details.write_text("\n".join(readme.markers("smallest")))
    compare_readme.write(found, path)
    made = readme.part(details.read_text(), "smallest")
    assert "| actuator filters | too few flights (2/3) |" in made and "liquid OFC, one segment" in made


def test_picture_counts_flights_beyond_the_common_threshold(found):
    svg = ElementTree.fromstring(render(found.rows, stats.equal_thresholds(found.rows, 0.0)))
    words = [t.text for t in svg.iter("{http://www.w3.org/2000/svg}text")]
    # three oscillations each, of 1, 2 and 4 mm: |r| 0.7, 3, 9 against fault-free maxima of 0.8 and 1.5
    assert sorted(w for w in words if "/" in w) == ["0/1", "0/1", "1/1", "1/1", "1/1", "1/1"]
    assert {"iotsekf: actuator filters", "lpv_smo: airframe motion"} <= set(words)
    never = {name: (None, 0, 4, 1.0) for name in ("iotsekf", "lpv_smo")}
    words = [t.text for t in ElementTree.fromstring(render(found.rows, never)).iter() if t.text and "/1" in t.text]
    assert set(words) == {"0/1"}


SWAPPED = "<!-- compare: end --><!-- compare: begin -->"


@pytest.mark.parametrize("text", ["", "no markers", "<!-- compare: begin -->", "<!-- compare: end -->\n" * 2, SWAPPED])
def test_file_without_the_markers_is_left_alone(found, tmp_path, text):
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(OutputError, match="markers"):
        readme.replace(path, "compare", "x")
    assert path.read_text() == text
    with pytest.raises(OutputError, match="cannot be read"):
        readme.replace(tmp_path / "none.md", "compare", "x")


def test_a_picture_without_an_oscillation_is_empty():
    from cosim.report.compare_picture import render

    rows = {"frequency_hz": [float("nan")], "amplitude_mm": [1.0], "concerned": [True], "id": ["iotsekf"]}
    assert render(pd.DataFrame(rows), {}).startswith("<svg")


@pytest.mark.parametrize("line", [b"\n", b"\r\n"])
def test_line_ends_and_a_byte_order_mark_stay(found, tmp_path, line):
    path, (begin, end) = tmp_path / "README.md", (m.encode() for m in readme.markers("compare"))
    path.write_bytes(b"\xef\xbb\xbf" + line.join([b"before", begin, b"old", end, b"after", b""]))
    compare_readme.write(found, path)
    lines = path.read_bytes().removeprefix(b"\xef\xbb\xbf").split(line)
    assert lines[0] == b"before" and lines[-2:] == [b"after", b""] and len(lines) > 8
    assert not any(b"\r" in text or b"\n" in text for text in lines)
    assert path.read_bytes().startswith(b"\xef\xbb\xbf")


def test_a_pipe_is_refused(found, tmp_path):
    os.mkfifo(tmp_path / "README.md")
    with pytest.raises(OutputError, match="no regular file"):
        compare_readme.targets(tmp_path / "README.md")
    told = CliRunner().invoke(cli.app, ["compare", "none", "-o", str(tmp_path), "--readme", f"{tmp_path}/README.md"])
    assert told.exit_code == 2 and "no regular file" in told.stderr


def test_a_picture_that_the_table_does_not_show_stays(found, tmp_path):
    path, picture = tmp_path / "README.md", tmp_path / compare_readme.PICTURE
    path.write_text("\n".join(readme.markers("compare")))
    picture.parent.mkdir(parents=True)
    picture.write_text("mine")
    before = path.read_text()
    with pytest.raises(OutputError, match="no picture of the table"):
        compare_readme.write(found, path)
    assert picture.read_text() == "mine" and path.read_text() == before
    picture.unlink()
    for _ in range(2):
        compare_readme.write(found, path)
        assert picture.read_text().startswith("<svg")
    path.write_text(before)  # as it was, the picture is still known for ours
    compare_readme.write(found, path)


@pytest.mark.parametrize("text", ["no markers", "\n".join(readme.markers("smallest")) + "<!-- compare: begin -->"])
def test_nothing_is_written_when_one_page_lacks_its_markers(found, tmp_path, text):
    path, details = tmp_path / "README.md", tmp_path / compare_readme.DETAILS
    details.parent.mkdir(parents=True)
    path.write_text("\n".join(readme.markers("compare")))
    details.write_text(text)
    before = path.read_text()
    with pytest.raises(OutputError, match="markers"):
        compare_readme.write(found, path)
    assert path.read_text() == before and details.read_text() == text
    assert not (tmp_path / compare_readme.PICTURE).exists()
