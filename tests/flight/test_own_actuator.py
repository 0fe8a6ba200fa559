"""Own actuators: an FMU of the hydraulic model flies like the block, a block from a file like itself; what is wrong is
told in the FMU's own words.
"""

import gc
import textwrap

import fmu_of_hydraulic as rig
import numpy as np
import pytest
import technologies

import cosim
from cosim.errors import ScenarioError
from cosim.replay import replay
from cosim.scenario import catalog

SHORT = ["duration_s=6", "faults.0.start_s=2", "detectors.enabled=[]", "elevator.feedback=measured",
         "elevator.right_inner=simple", "elevator.right_outer=simple"]  # fmt: skip
SEEN = ["truth.aircraft.de_li", "truth.aircraft.q", "sensors.left_inner_rod.y", "sensors.left_inner_pressure.y"]


@pytest.fixture(scope="module", params=[2, 3])
def fmu(request, tmp_path_factory):
    if rig.COMPILER is None:
        pytest.skip("no C compiler on this machine")
    return rig.build(tmp_path_factory.mktemp("fmu"), request.param)


@pytest.fixture(autouse=True)
def forget():
    yield
    technologies.forget()


def loaded(path, *changes, key="fmu", spec=None):
    table = {key: str(path), **(rig.MAP if spec is None else spec)}
    said = [f"actuators.rig.{k}={_toml(v)}" for k, v in table.items()]
    return cosim.load_scenario("liquid-ofc", [*SHORT, *said, "elevator.left_inner=rig", *changes])


def _toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = '{v}'" for k, v in value.items()) + "}"
    return f"'{value}'" if isinstance(value, str) else str(value)


def test_the_fmu_flies_like_the_block(fmu):
    """Same steps inside, same values held over a tick: what differs is rounding, through the aircraft's loop."""
    own = cosim.fly(loaded(fmu), SEEN).to_numpy()
    block = cosim.fly(cosim.load_scenario("liquid-ofc", SHORT), SEEN).to_numpy()
    moved = np.ptp(block[:, 0])
    assert moved > np.radians(0.5)
    assert np.abs(own[:, 0] - block[:, 0]).max() < 1e-6 * moved
    assert np.abs(own - block).max() < 1e-5


def test_its_parameters_are_set(fmu):
    own = cosim.fly(loaded(fmu, "actuators.rig.parameters.P_s=1.0e7", "duration_s=1"), SEEN).to_numpy()
    block = cosim.fly(cosim.load_scenario("liquid-ofc", [*SHORT, "duration_s=1"]), SEEN).to_numpy()
    assert own[0, 3] == pytest.approx(block[0, 3] * 1.4, abs=0.05)  # the same load on less supply


def test_its_own_message_says_what_went_wrong(fmu, tmp_path):
    s = loaded(fmu, "actuators.rig.parameters.breaks_s=1.0", "duration_s=3")
    with pytest.raises(ScenarioError, match=r"actuators\.rig: seal lost at the piston"):
        cosim.simulate(s, log=tmp_path / "rig.mcap")


def test_a_fatal_error_is_told_and_the_process_lives(fmu):
    """FMI: after it no function may be called any more; this FMU ends the process that does."""
    s = loaded(fmu, "actuators.rig.parameters.breaks_s=0.5", "actuators.rig.parameters.breaks_as=4", "duration_s=1")
    with pytest.raises(ScenarioError, match=r"actuators\.rig: seal lost at the piston; fmi.DoStep .*fatal"):
        cosim.fly(s, SEEN)
    gc.collect()


@pytest.mark.parametrize(
    ("how", "says"),
    [(5, r"ended the simulation at 0\.505 s \(terminateSimulation\)"), (6, r"came to 0\.507000 s .* to 0\.510 s"),
     (7, r"came to 0\.507000 s")],
)  # fmt: skip
def test_an_fmu_that_stops_ends_the_flight_in_a_line(tmp_path, how, says):
    """Also where its status is good: it is at the end, it returns early, it has not come to the end of the step."""
    if rig.COMPILER is None:
        pytest.skip("no C compiler on this machine")
    breaks = "actuators.rig.parameters.breaks_s=0.5", f"actuators.rig.parameters.breaks_as={how}"
    with pytest.raises(ScenarioError, match=rf"actuators\.rig: {says}"):
        cosim.fly(loaded(rig.build(tmp_path, 3), *breaks, "duration_s=1"), SEEN)


@pytest.mark.parametrize(
    ("flag", "changes", "says"),
    [
        ("canBeInstantiatedOnlyOncePerProcess='true'", ["elevator.left_outer=rig"],
         "canBeInstantiatedOnlyOncePerProcess: it cannot be on 2 segments"),
        ("needsExecutionTool='true'", [], "needsExecutionTool: it runs only beside"),
        ("fixedInternalStepSize='0.003'", [], r"fixedInternalStepSize = 0\.003 s does not divide the tick of 0\.005 s"),
    ],
)  # fmt: skip
def test_what_the_model_description_asks_and_the_loop_cannot_do_is_refused_by_name(tmp_path, flag, changes, says):
    if rig.COMPILER is None:
        pytest.skip("no C compiler on this machine")
    path = rig.described(rig.build(tmp_path, 3), "<CoSimulation", f"<CoSimulation {flag}")
    with pytest.raises(ScenarioError, match=rf"actuators\.rig: {says}"):
        cosim.fly(loaded(path, *changes, "duration_s=0.1"), SEEN)


def test_an_fmu_for_one_instance_flies_on_one_segment(tmp_path):
    if rig.COMPILER is None:
        pytest.skip("no C compiler on this machine")
    flag = "<CoSimulation canBeInstantiatedOnlyOncePerProcess='true' fixedInternalStepSize='0.0025'"
    path = rig.described(rig.build(tmp_path, 3), "<CoSimulation", flag)
    assert len(cosim.fly(loaded(path, "duration_s=0.1"), SEEN)) == 20


def test_a_unit_left_out_is_the_one_that_the_fmu_declares(fmu):
    change = "actuators.rig.outputs.rod={variable='rod'}", "duration_s=0.5"
    want = cosim.fly(loaded(fmu, "duration_s=0.5"), SEEN).to_numpy()
    np.testing.assert_array_equal(cosim.fly(loaded(fmu, *change), SEEN).to_numpy(), want)


def test_a_flight_with_an_fmu_replays(fmu, tmp_path):
    s = loaded(fmu, "detectors.enabled=['position_monitor', 'iotsekf']", "duration_s=4")
    cosim.simulate(s, log=tmp_path / "rig.mcap")
    technologies.forget()
    fmu.rename(fmu.with_suffix(".gone"))  # a log needs no FMU to be replayed
    try:
        assert replay(tmp_path / "rig.mcap").exact
    finally:
        fmu.with_suffix(".gone").rename(fmu)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("actuators.rig.outputs.rod={variable='rood', unit='m'}", "has no variable 'rood'"),
        ("actuators.rig.outputs.rod={variable='rod', unit='yd'}", "'yd' is no unit of rod; allowed: m, mm, cm, in"),
        ("actuators.rig.outputs.surface={variable='delta', unit='N m'}", "'N m' is no unit of surface"),
        ("actuators.rig.outputs.rod={variable='rod', unit='mm'}", "its variable 'rod' is in m, not in mm"),
        ("actuators.rig.inputs.valve_command={variable='P_s'}", "'P_s' is no input but parameter"),
        ("actuators.rig.outputs.rod={variable='u', unit='m'}", "'u' is no output but input"),
        ("actuators.rig.inputs.command={variable='u'}", "'command' is no word of inputs"),
        ("actuators.rig.start.rod={variable='delta_0'}", "'rod' is no word of start"),
        ("actuators.rig.inputs.speed={variable='u'}", "'speed' is no word of inputs"),
        ("actuators.rig.servo=''", "inputs.command: is missing"),
    ],
)
def test_a_wrong_map_is_refused(fmu, change, says):
    with pytest.raises(ScenarioError, match=says):
        cosim.fly(loaded(fmu, change, "duration_s=0.1"), SEEN)


def test_what_is_no_fmu_is_refused(tmp_path):
    path = tmp_path / "x.fmu"
    path.write_bytes(b"no zip")
    with pytest.raises(ScenarioError, match=r"actuators\.rig: .*zip"):
        cosim.fly(loaded(path, "duration_s=0.1"), SEEN)
    with pytest.raises(ScenarioError, match=r"no such file"):
        loaded(tmp_path / "y.fmu")


BLOCK = '''
    """A first-order actuator in plain Python."""
    import numpy as np
    from actuators.block import dtype

    PARAMS = dtype([("tau", "f8", "s")])
    INPUTS = dtype([(n, "f8") for n in ("command", "hm0", "hmd", "f_cmd", "s_cmd")])
    STATE = dtype([("delta", "f8", "rad")])
    OUTPUTS = ("delta",)

    def params(tau=0.1):
        p = np.zeros(1, PARAMS)
        p["tau"] = tau
        return p

    def init_at(p, delta, hm0, hmd):
        x = np.zeros(p.shape, STATE)
        x["delta"] = delta
        return x

    def rollout(x, u, p, dt):
        for i in range(len(x)):
            asked = (1.0 - u[i, 0].s_cmd) * u[i, 0].command + u[i, 0].f_cmd
            x[i].delta += dt / p[i].tau * (asked - x[i].delta)
'''


def test_a_block_from_a_file_flies_and_takes_faults_of_its_command(tmp_path):
    path = tmp_path / "first_order.py"
    path.write_text(textwrap.dedent(BLOCK))
    s = loaded(path, "faults.0.at=command", "faults.0.amplitude_deg=1.0", key="file", spec={})
    found = cosim.fly(s, [*SEEN[:2], "sensors.left_inner_surface.y"]).to_numpy()
    assert np.radians(1.0) < np.ptp(found[800:, 0]) < np.radians(2.0)  # lagging, and the law works against it
    with pytest.raises(ScenarioError, match="which has no valve"):
        loaded(path, "faults.0.at=valve", "faults.0.amplitude=0.02", key="file", spec={})


def test_a_compiled_block_from_a_file_behind_the_shipped_servo_flies_like_itself(tmp_path):
    path = tmp_path / "same.py"
    path.write_text(
        "from actuators.hydraulic.actuator import INPUTS, OUTPUTS, PARAMS, STATE, init_at, params, rollout\n"
    )
    own = cosim.fly(loaded(path, key="file", spec={"servo": "hydraulic"}), SEEN).to_numpy()
    np.testing.assert_array_equal(own, cosim.fly(cosim.load_scenario("liquid-ofc", SHORT), SEEN).to_numpy())


def test_a_file_that_is_no_block_is_told(tmp_path):
    path = tmp_path / "half.py"
    path.write_text(textwrap.dedent(BLOCK).replace('"f_cmd", ', ""))
    with pytest.raises(ScenarioError, match=r"half\.py has no INPUTS\.f_cmd"):
        cosim.fly(loaded(path, "faults.0.at=command", "faults.0.amplitude_deg=1.0", key="file", spec={}), SEEN[:2])
    path.write_text("1 / 0")
    with pytest.raises(ScenarioError, match=r"half\.py: does not run: ZeroDivisionError"):
        cosim.fly(loaded(path, "faults.0.at=command", "faults.0.amplitude_deg=1.0", key="file", spec={}), SEEN[:2])


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("if u[0, 0].f_cmd > 0: raise ValueError('pump\\nis dry')", r"own\.py: at 2\.\d+ s ValueError: pump is dry "),
        ("raise SystemExit(3)", r"own\.py: at 0\.000 s SystemExit: 3"),
        ("x[0].delta *= float('nan') if u[0, 0].f_cmd > 0 else 1", r"at 2\.\d+ s ValueError: delta = \[nan\]"),
    ],
)
def test_a_block_that_raises_or_exits_is_told_with_its_time_and_leaves_a_readable_log(tmp_path, line, says):
    path = tmp_path / "own.py"
    path.write_text(textwrap.dedent(BLOCK) + f"        {line}\n")
    s = loaded(path, "faults.0.at=command", "faults.0.amplitude_deg=1.0", "duration_s=3", key="file", spec={})
    with pytest.raises(ScenarioError, match=says):
        cosim.simulate(s, log=tmp_path / "own.mcap")
    assert cosim.open_log(tmp_path / "own.mcap").frame("/truth/aircraft").index[-1] >= 0.0


def test_an_actuator_that_was_read_changes_no_other_scenario(tmp_path):
    """The text of a scenario is its run's id: it must not depend on what this process has read before."""
    before = cosim.load_scenario("cruise").expanded_toml()
    (tmp_path / "rig.fmu").touch()
    loaded(tmp_path / "rig.fmu")
    assert "rig" in catalog.TECHNOLOGIES and cosim.load_scenario("cruise").expanded_toml() == before
    with pytest.raises(ScenarioError, match=r"allowed: hydraulic, ema, simple$"):
        cosim.load_scenario("cruise", ["elevator.left_inner=rig"])
