"""`cosim run --live`: a WebSocket client watches, injects, heals; the log holds it and replays bit for bit."""

import threading

import pytest

import cosim
from cosim.errors import CosimError
from cosim.flight.interactive.live import fly_live
from cosim.log import open_log
from cosim.replay import replay

pytest.importorskip("foxglove", reason="foxglove-sdk is an extra (live)")
pytest.importorskip("websockets")
from foxglove_client import Viewer
from websockets.exceptions import InvalidStatus

KEYS = ["detectors.enabled=['iotsekf', 'position_monitor']", "flight.turbulence=light"]
OFC = {"target": "elevator.left_inner", "kind": "ofc_liquid", "amplitude_mm": 8.0, "frequency_hz": 2.0}


def hands(scenario, path, act, speed=4.0):
    """Fly live while `act(server)` runs in a thread of its own; return (result, what it returned)."""
    seen = {}

    def ready(server):
        def run():
            try:
                seen["done"] = act(server)
            except BaseException as error:  # told in the test's own thread
                seen["error"] = error

        seen["thread"] = threading.Thread(target=run, daemon=True)
        seen["thread"].start()

    result, _ = fly_live(scenario, port=0, log=path, speed=speed, ready=ready)
    seen["thread"].join(30.0)
    if "error" in seen:
        raise seen["error"]
    return result, seen["done"]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A client watches, breaks an elevator, asks for nonsense, mends the elevator by a service, and goes faster."""
    path = tmp_path_factory.mktemp("live") / "flight.mcap"

    def act(server):
        with Viewer(server.url) as v:
            v.watch("/truth")
            v.until(lambda: v.samples.get("/truth"))
            broken = v.call("inject", **OFC)
            v.watch("/faults")
            v.until(lambda: len(v.samples.get("/faults", ())) > 20)
            wrong = [
                v.call("inject", target="elevator.left_inner", kind="jam_sollid"),
                v.call("inject", **{**OFC, "self": 1}), v.call("inject"), v.call("inject", **{**OFC, "start_s": 0.0}),
                v.call("heal", fault=7), v.call("heal", fault="x"), v.call("speed", value=-1),
            ]  # fmt: skip
            healed = v.call("heal", fault=0)
            quick = v.call("speed", value=50)
            return {"broken": broken, "wrong": wrong, "healed": healed, "quick": quick, "samples": v.samples}

    s = cosim.load_scenario("cruise", [*KEYS, "duration_s=40"])
    result, seen = hands(s, path, act)
    return path, result, seen


def test_what_a_viewer_injects_is_in_the_log_with_its_tick_and_replays(flown):
    path, result, seen = flown
    assert seen["broken"]["ok"] and seen["healed"]["ok"] and seen["quick"]["ok"], seen
    first, last = seen["broken"]["tick"], seen["healed"]["tick"]
    log = open_log(path)
    active = log.frame("/faults/f0_left_inner")["active"].to_numpy()
    assert 0 < first < last < len(active) == 8000
    assert set(active[:first]) == {0.0} and set(active[first:last]) == {1.0} and set(active[last:]) == {0.0}
    assert result.faults[0]["start_s"] == first * 0.005 and result.status == "completed"
    assert any(d["detection_delay_s"] is not None for d in result.detectors if d["id"] == "iotsekf")
    assert replay(path).exact


def test_nonsense_is_answered_and_nothing_else_happens(flown):
    said = [answer["error"] for answer in flown[2]["wrong"]]
    assert not any(answer["ok"] for answer in flown[2]["wrong"])
    assert "Did you mean 'jam_solid'" in said[0] and "has passed" in said[3] and "is no speed" in said[6]
    assert all("no fault of this number" in told for told in said[4:6])
    assert "ofc_liquid on elevator.left_inner" in flown[2]["healed"]["faults"]


def test_without_the_token_nobody_comes_in():
    def act(server):
        turned_away, (place, token) = [], server.url.split("?token=")
        strange = ("", None), ("?token=guess", None), ("?token=", None), (f"?token={token}", "https://evil.example")
        for tail, origin in strange:
            try:
                Viewer(f"{place}{tail}", origin).__exit__()
            except InvalidStatus as error:
                turned_away.append(error.response.status_code)
        with Viewer(server.url, "https://app.foxglove.dev") as v:
            turned_away.append(v.call("speed", value=1000)["ok"])
        return turned_away

    s = cosim.load_scenario("cruise", [*KEYS, "duration_s=2"])
    assert hands(s, None, act, speed=0.5)[1] == [403, 403, 403, 403, True]


def test_the_speed_that_is_told_is_the_clocks():
    result, _ = fly_live(cosim.load_scenario("cruise", [*KEYS, "duration_s=1"]), port=0, speed=2.0)
    assert result.wall_time_s > 0.4  # no flight is ahead of its clock


def test_a_speed_that_is_none_is_refused():
    with pytest.raises(CosimError, match=r"0\.0 is no speed; allowed: 0\.01 to 1000"):
        fly_live(cosim.load_scenario("cruise", KEYS), port=0, speed=0.0)


CHATTY = """
class Chatty:
    id, level, technologies, inputs = "chatty", "local", ("hydraulic",), ("rod",)
    def __init__(self, dt): pass
    def update(self, t, y):
        print("rod is", y.rod)
        if t > 0.3:
            raise KeyboardInterrupt
"""


def test_ctrl_c_ends_it_with_a_whole_log_and_what_a_user_detector_prints_stays_apart(tmp_path, capsys):
    from cosim.parts import with_detectors
    from fdi import registry

    (tmp_path / "chatty.py").write_text(CHATTY)
    s = with_detectors(cosim.load_scenario("cruise", [*KEYS, "duration_s=2"]), [tmp_path / "chatty.py"])
    result, flown = fly_live(s, port=0, log=tmp_path / "cut.mcap", speed=1000.0)
    registry.USER_DETECTORS.clear()
    assert result.status == "interrupted" and flown.ticks == 61
    assert open_log(tmp_path / "cut.mcap").complete and open_log(tmp_path / "cut.mcap").n_ticks == 61
    out, err = capsys.readouterr()
    assert out == "" and "rod is" in err
