"""User actuators: an FMU of the hydraulic model flies like the block, a block from a file or a folder like itself; what
is wrong is told in the FMU's own words.
"""

import functools
import gc
import importlib
import shutil
import sys
import textwrap
from pathlib import Path

import fmu_of_hydraulic as rig
import numpy as np
import pytest
import technologies

import actuators.hydraulic.record as shipped
import cosim
from cosim.errors import ScenarioError
from cosim.replay import replay
from cosim.scenario import catalog

SHORT = ["duration_s=6", "faults.0.start_s=2", "detectors.enabled=[]", "elevator.feedback=measured",
         "elevator.right_inner=simple", "elevator.right_outer=simple"]  # fmt: skip
SEEN = ["truth.aircraft.de_li", "truth.aircraft.q", "sensors.left_inner_rod.y", "sensors.left_inner_pressure.y"]
needs_compiler = pytest.mark.skipif(rig.COMPILER is None, reason="no C compiler on this machine")


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


@functools.cache
def as_shipped(*changes):
    return cosim.fly(cosim.load_scenario("liquid-ofc", [*SHORT, *changes]), SEEN).to_numpy()


def test_the_fmu_flies_like_the_block(fmu):
    """Same steps inside, same values held over a tick: what differs is rounding, through the aircraft's loop."""
    own, moved = cosim.fly(loaded(fmu), SEEN).to_numpy(), np.ptp(as_shipped()[:, 0])
    assert moved > np.radians(0.5) and np.abs(own[:, 0] - as_shipped()[:, 0]).max() < 1e-6 * moved
    assert np.abs(own - as_shipped()).max() < 1e-5
    weak = "actuators.rig.parameters.P_s=1.0e7", "actuators.rig.outputs.rod={variable='rod'}", "duration_s=0.1"
    half = cosim.fly(loaded(fmu, *weak), SEEN).to_numpy()  # a unit left out is the one that the FMU declares
    assert half[0, 2] == pytest.approx(own[0, 2]) and half[0, 3] == pytest.approx(1.4 * own[0, 3], abs=0.05)


def test_a_flight_with_an_fmu_replays(fmu, tmp_path):
    cosim.simulate(loaded(fmu, "detectors.enabled=['position_monitor', 'iotsekf']"), log=tmp_path / "rig.mcap")
    technologies.forget()
    fmu.rename(fmu.with_suffix(".gone"))  # a log needs no FMU to be replayed
    try:
        assert replay(tmp_path / "rig.mcap").exact
    finally:
        fmu.with_suffix(".gone").rename(fmu)


@needs_compiler
@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("3", r"seal lost at the piston"), ("4", r"seal lost at the piston; fmi.DoStep .*fatal"),
        ("5", r"ended the simulation at 0\.505 s \(terminateSimulation\)"),
        ("6", r"came to 0\.507000 s .* to 0\.510 s"), ("7", r"came to 0\.507000 s"),
    ],
)  # fmt: skip
def test_an_fmu_that_stops_ends_the_flight_in_a_line_and_the_process_lives(tmp_path, how, says):
    """Also where its status is good: it is at the end, it returns early, it has not come to the end of the step. After
    a fatal error no function may be called any more; this FMU ends the process that does."""
    breaks = "actuators.rig.parameters.breaks_s=0.5", f"actuators.rig.parameters.breaks_as={how}"
    with pytest.raises(ScenarioError, match=rf"actuators\.rig: {says}"):
        cosim.fly(loaded(rig.build(tmp_path, 3), *breaks, "duration_s=1"), SEEN)
    gc.collect()


@needs_compiler
@pytest.mark.parametrize(
    ("flag", "changes", "says"),
    [
        ("canBeInstantiatedOnlyOncePerProcess='true'", ["elevator.left_outer=rig"],
         "canBeInstantiatedOnlyOncePerProcess: it cannot be on 2 segments"),
        ("needsExecutionTool='true'", [], "needsExecutionTool: it runs only beside"),
        ("fixedInternalStepSize='0.003'", [], r"fixedInternalStepSize = 0\.003 s does not divide the tick of 0\.005 s"),
        ("canBeInstantiatedOnlyOncePerProcess='true' fixedInternalStepSize='0.0025'", [], None),
    ],
)  # fmt: skip
def test_what_the_model_description_asks_and_the_loop_cannot_do_is_refused_by_name(tmp_path, flag, changes, says):
    path = rig.described(rig.build(tmp_path, 3), "<CoSimulation", f"<CoSimulation {flag}")
    if says is None:
        assert len(cosim.fly(loaded(path, "duration_s=0.1"), SEEN)) == 20
        return
    with pytest.raises(ScenarioError, match=rf"actuators\.rig: {says}"):
        cosim.fly(loaded(path, *changes, "duration_s=0.1"), SEEN)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("actuators.rig.outputs.rod={variable='rood', unit='m'}", "has no variable 'rood'"),
        ("actuators.rig.outputs.rod={variable='rod', unit='yd'}", "'yd' is no unit of rod; allowed: m, mm, cm, in"),
        ("actuators.rig.outputs.surface={variable='delta', unit='N m'}", "'N m' is no unit of surface"),
        ("actuators.rig.outputs.rod={variable='rod', unit='mm'}", "its variable 'rod' is in m, not in mm"),
        ("actuators.rig.inputs.valve_command={variable='P_s'}", "'P_s' is no input but parameter"),
        ("actuators.rig.outputs.rod={variable='u', unit='m'}", "'u' is no output but input"),
        ("actuators.rig.inputs.command={variable='u'}", "inputs.command: unknown key for inputs"),
        ("actuators.rig.start.rod={variable='delta_0'}", "start.rod: unknown key for start"),
        ("actuators.rig.servo=''", "unknown key for inputs.*mean 'command'"),
    ],
)
def test_a_wrong_map_is_refused(fmu, change, says):
    with pytest.raises(ScenarioError, match=says) as caught:
        cosim.fly(loaded(fmu, change, "duration_s=0.1"), SEEN)
    assert not caught.value.more


def test_what_is_no_fmu_is_refused_and_what_was_read_changes_no_other_scenario(tmp_path):
    """The text of a scenario is its run's id: it must not depend on what this process has read before."""
    before = cosim.load_scenario("cruise").expanded_toml()
    (tmp_path / "x.fmu").write_bytes(b"no zip")
    with pytest.raises(ScenarioError, match=r"actuators\.rig: .*zip"):
        cosim.fly(loaded(tmp_path / "x.fmu", "duration_s=0.1"), SEEN)
    with pytest.raises(ScenarioError, match=r"no such file"):
        loaded(tmp_path / "y.fmu")
    assert "rig" in catalog.TECHNOLOGIES and cosim.load_scenario("cruise").expanded_toml() == before
    with pytest.raises(ScenarioError, match=r"allowed: hydraulic, ema, simple$"):
        cosim.load_scenario("cruise", ["elevator.left_inner=rig"])


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
COMMAND = "faults.0.at=command", "faults.0.amplitude_deg=1.0"


def test_a_block_from_a_file_flies_and_takes_faults_of_its_command(tmp_path):
    path = tmp_path / "first_order.py"
    path.write_text(textwrap.dedent(BLOCK))
    found = cosim.fly(loaded(path, *COMMAND, key="file", spec={}), SEEN[:2]).to_numpy()
    assert np.radians(1.0) < np.ptp(found[800:, 0]) < np.radians(2.0)  # lagging, and the law works against it
    with pytest.raises(ScenarioError, match="which has no valve"):
        loaded(path, "faults.0.at=valve", "faults.0.amplitude=0.02", key="file", spec={})


def test_a_compiled_block_from_a_file_behind_the_shipped_servo_flies_like_itself(tmp_path):
    path = tmp_path / "same.py"
    path.write_text(
        "from actuators.hydraulic.actuator import INPUTS, OUTPUTS, PARAMS, STATE, init_at, params, rollout\n"
    )
    own = cosim.fly(loaded(path, key="file", spec={"servo": "hydraulic"}), SEEN).to_numpy()
    np.testing.assert_array_equal(own, as_shipped())


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        (BLOCK, "if u[0, 0].f_cmd > 0: raise ValueError('pump\\nis dry')", r"at 2\.\d+ s ValueError: pump is dry "),
        (BLOCK, "raise SystemExit(3)", r"at 0\.000 s SystemExit: 3"),
        (BLOCK, "x[0].delta *= float('nan') if u[0, 0].f_cmd > 0 else 1", r"at 2\.\d+ s ValueError: delta = \[nan\]"),
        (BLOCK.replace('"f_cmd", ', ""), "", r"own\.py has no INPUTS\.f_cmd"),
        ("1 / 0", "", r"own\.py: does not run: ZeroDivisionError"),
        (BLOCK.partition("def rollout")[0] + "from actuators.block import entry, kernel\n    @kernel\n"
         "    def step(x, u, p, dt):\n        x.delta = np.zeros(2)[0]\n"
         "    rollout = entry(step, STATE, INPUTS, PARAMS)\n", "", r"own\.py: .* function zeros"),
    ],
)
def test_a_block_that_raises_or_is_none_is_told_with_its_time_and_leaves_a_readable_log(tmp_path, text, line, says):
    path = tmp_path / "own.py"
    path.write_text(textwrap.dedent(text) + f"        {line}\n" * bool(line))
    with pytest.raises(ScenarioError, match=says):
        s = loaded(path, *COMMAND, "duration_s=3", key="file", spec={})
        cosim.simulate(s, log=tmp_path / "own.mcap")
    if line:
        assert cosim.open_log(tmp_path / "own.mcap").frame("/truth/aircraft").index[-1] >= 0.0


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """Register a throw-away technology: the hydraulic folder under other names."""
    folder = shutil.copytree(Path(shipped.__file__).parent, tmp_path / "rig_folder")
    for path in folder.glob("*.py"):
        text = path.read_text().replace("actuators.hydraulic", "rig_folder")
        for old, new in (("servo", "rig_servo"), ("hydraulic", "rig"), ("valve_command", "rig_command")):
            text = text.replace(f'"{old}"', f'"{new}"')
        path.write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    own = importlib.import_module("rig_folder.record").TECHNOLOGY
    monkeypatch.setattr(catalog, "SHIPPED", (*catalog.SHIPPED, own))  # the one line
    catalog.register(own)
    yield
    for name in [n for n in sys.modules if n.startswith("rig_folder")]:
        del sys.modules[name]


def test_a_technology_is_a_folder_and_a_line_its_copy_flies_like_its_template(copied):
    s = cosim.load_scenario("liquid-ofc", [*SHORT, "elevator.left_inner=rig", "tolerances.rig.P_s=1.0"])
    np.testing.assert_array_equal(cosim.fly(s, SEEN).to_numpy(), as_shipped())
    assert (s.elevator.feedback["left_inner"], s.tolerances.rig) == ("measured", {"P_s": 1.0})
    assert "rig" in catalog.ELEVATOR_KINDS["air_in_oil"].technologies
