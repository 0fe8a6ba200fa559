"""Memory and disk of a log are bounded: parts of a topic are read alone, what would not fit is refused before."""

import tracemalloc

import numpy as np
import pytest

import cosim
from cosim.log import LogWriter, Topic, open_log
from cosim.report import flight_report

TICKS = 8000


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return a log of 40 s with a topic of every tick, and one of every tenth."""
    path = tmp_path_factory.mktemp("bounded") / "a.mcap"
    topics = [Topic("/a", ("x", "y", "z"), ("m", "s", "-"), [0, 1, 2]), Topic("/b", ("w",), ("-",), [3], every=10)]
    with LogWriter(path, topics, n_values=4) as writer:
        for k in range(TICKS):
            writer.append(np.array([k, 2.0 * k, np.sin(k), -k]))
        writer.close(result={"status": "completed"})
    return path


def test_a_part_of_a_topic_has_the_bits_of_the_whole(path):
    log = open_log(path)
    for topic, fields in (("/a", ["y", "x"]), ("/b", ["w"])):
        whole = log.frame(topic)
        for start, end in ((None, None), (1.0, 30.0), (0.1 * 3, 0.7), (39.99, 1e9), (None, 0.0), (50.0, None)):
            part = log.frame(topic, fields=fields, start_s=start, end_s=end)
            wanted = whole[(whole.index >= (start or 0.0)) & (whole.index < (1e9 if end is None else end))][fields]
            assert part.equals(wanted) and part.attrs["units"] == {f: whole.attrs["units"][f] for f in fields}
    with pytest.raises(KeyError, match="has no field 'v'"):
        log.frame("/a", fields=["v"])


def test_the_memory_of_a_page_does_not_grow_with_the_flight(tmp_path, monkeypatch):
    monkeypatch.setattr("cosim.log.reader.CACHE_BYTES", 1 << 20)
    monkeypatch.setattr("cosim.replay.detector_replay.SPAN", 800)

    def peak(seconds):
        asked = [f"duration_s={seconds}", "detectors.enabled=['iotsekf', 'lpv_smo']", "elevator.feedback=measured"]
        path = tmp_path / f"{seconds}.mcap"
        cosim.simulate(cosim.load_scenario("liquid-ofc", asked), log=path, timed=False)
        flight_report(path, tmp_path / "page.html")  # what is loaded once
        tracemalloc.start()
        try:
            flight_report(path, tmp_path / "page.html")
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    assert (peak(60) - peak(20)) / (40 * 200) < 32  # bytes per tick, of some 500 numbers
