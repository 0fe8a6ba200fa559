"""`cosim replay LOG --live`: a viewer plays, pauses and scrubs a log; what it gets is what the log holds."""

import threading

import pytest

import cosim
from cosim.errors import LogError
from cosim.log import open_log

pytest.importorskip("foxglove", reason="foxglove-sdk is an extra (live)")
pytest.importorskip("websockets")
from foxglove_client import Viewer

from cosim.replay.live import show

TOPIC, MS = "/truth/aircraft", 1_000_000


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("shown") / "flight.mcap"
    keys = ["duration_s=6", "detectors.enabled=['iotsekf']", "faults.0.start_s=2"]
    cosim.simulate(cosim.load_scenario("liquid-ofc", keys), log=path, timed=False)
    return path


@pytest.fixture
def served(log, request):
    """Serve the log at a tenth of the clock's speed, from 0 s or the time given [s]; give the server."""
    up, ended, kept = threading.Event(), threading.Event(), []

    def ready(server):
        kept.append(server)
        up.set()

    thread = threading.Thread(target=show, args=(log,), daemon=True,
                              kwargs={"port": 0, "speed": 0.1, "start_s": getattr(request, "param", 0.0),
                                      "ready": ready, "ended": ended})  # fmt: skip
    thread.start()
    assert up.wait(30)
    yield kept[0]
    ended.set()
    thread.join(10)
    assert not thread.is_alive()


def test_a_log_is_played_scrubbed_and_paused(served, log):
    frame = open_log(log).frame(TOPIC)
    with Viewer(served.url) as v:
        assert "playbackControl" in v.info["capabilities"] and not v.services
        v.watch("/truth")
        got = lambda: v.samples.get("/truth", ())  # noqa: E731
        v.until(lambda: len(got()) > 2)
        assert got()[0][0] < 1000 * MS  # from the start
        v.control(play=False, seek_ns=4000 * MS)
        v.until(lambda: got()[-1][0] == 4000 * MS)
        v.control(play=True, speed=5.0, seek_ns=1500 * MS)
        v.until(lambda: got()[-1][0] >= 5900 * MS)  # 4.4 s of flight in less than one
        v.until(lambda: any(s[0] == 3 for s in v.states))  # ended
        v.control(play=True, speed=50.0)
        v.until(lambda: got()[-1][0] < 1000 * MS)  # from the start again
        for ns, payload in got():
            assert frame["alpha"].iloc[ns // (5 * MS)].tobytes() in payload
            assert frame["de_li"].iloc[ns // (5 * MS)].tobytes() in payload


@pytest.mark.parametrize("served", [5.0], indirect=True)
def test_a_log_is_played_from_the_time_that_is_asked_for(served):
    with Viewer(served.url) as v:
        v.watch("/truth")
        v.until(lambda: v.samples.get("/truth", ()))
        assert 5000 * MS <= v.samples["/truth"][0][0] < 5100 * MS


def test_what_is_no_log_is_refused(tmp_path):
    (tmp_path / "no.mcap").write_bytes(b"nothing of the kind")
    with pytest.raises(LogError):
        show(tmp_path / "no.mcap", port=0)
