"""Scenarios that are refused, each with its place and remedy, and those that are only warned of."""

import pytest
from scenario_tables import OFC, POINT, fault, flight

from cosim.errors import ScenarioError
from cosim.scenario import load_scenario, parse
from cosim.scenario.aircraft import load_aircraft

JAM = fault("elevator.left", "jam_solid")
THRUST = fault("engine.all", "thrust_loss", loss_pct=60.0)
GUST = ("flight.gusts.0.start_s=3", "flight.gusts.0.speed_fps=-40")
INPUTS = ["manoeuvre.kind=inputs"]


def refused(*overrides, name="liquid-ofc"):
    """Check that a built-in scenario with these overrides is refused, a line for each mistake, and return the lines."""
    with pytest.raises(ScenarioError) as caught:
        load_scenario(name, overrides)
    assert all(line.startswith(("--set", f"{name}:")) for line in str(caught.value).splitlines())
    return str(caught.value)


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["flight.mas_t=3"], ["flight.mas_t = 3", "unknown key", "mass_t"]),
        (["flight.mass_t=3"], ["flight.mass_t = 3", "180 to 405"]),
        (["flight.mass_t=nan"], ["flight.mass_t = nan", "180 to 405"]),
        (["flight.cg_pct=heavy"], ['flight.cg_pct = "heavy"', "number", "20 to 40"]),
        (["flight.mach=0.99"], ["flight.mach = 0.99", "0.2 to 0.95"]),
        (["flight.turbulence=lite"], ['flight.turbulence = "lite"', "light"]),
        (["duration_s=0"], ["duration_s = 0", "above 0"]),
        (["duration_s=true"], ["duration_s", "a valid number"]),
        (["seed=-1"], ["seed = -1", "out of range", "0 to"]),
        (["seed=1.5"], ["seed = 1.5", "integer"]),
        (["durations=3"], ["durations", "Did you mean 'duration_s'?"]),
        (["manoeuvre.kind=cruis"], ['manoeuvre.kind = "cruis"', "Did you mean 'cruise'?"]),
        (["manoeuvre.kind=nz_doublet", "manoeuvre.amplitude_g=9"], ["manoeuvre.amplitude_g = 9", "-1.5 to 1.5"]),
        (["manoeuvre.kind=nz_doublet", "manoeuvre.bank_deg=9"], ["manoeuvre.bank_deg", "unknown key", "width_s"]),
        (["elevator.left_inner=emma"], ['elevator.left_inner = "emma"', "hydraulic, ema, simple"]),
        (["elevator.feedback=iotsek"], ['elevator.feedback = "iotsek"', "Did you mean 'iotsekf'?"]),
        (["sensors.alfa.sigma_deg=1"], ["sensors.alfa", "Did you mean 'alpha'?"]),
        (["sensors.alpha.sigma_rad=1"], ["sensors.alpha.sigma_rad", "sigma_deg"]),
        (["tolerances.aero.Cm_alpha=9"], ["tolerances.aero.Cm_alpha = 9", "out of range"]),
        (["tolerances.aero.Cm_alfa=1.1"], ["tolerances.aero.Cm_alfa", "Did you mean 'Cm_alpha'?"]),
        (["tolerances.hydraulic.nope=1.1"], ["tolerances.hydraulic.nope", "P_s"]),
        (["tolerances.ema.nope=1.1"], ["tolerances.ema.nope", "K_T, K_B, R, L"]),
        (['detectors.enabled=["iotsek"]'], ["detectors.enabled.0", "Did you mean 'iotsekf'?"]),
        (["detectors.enabled=[iotsefk]"], ["detectors.enabled.0", "Did you mean 'iotsekf'?"]),
        (["detectors.enabled=[mine]"], ["'mine' is no detector", "joint, or one of your own by --detector FILE"]),
        (['detectors.enabled=["rfafe", "rfafe"]'], ["detectors.enabled.1", "twice"]),
        (["detectors.rfafee.x=2"], ["detectors.rfafee", "Did you mean 'rfafe'?"]),
        (["faults.0.frequency_hz=300"], ["faults.0.frequency_hz = 300", "0.01 to 25"]),
        (["faults.0.freqency_hz=3"], ["faults.0.freqency_hz", "Did you mean 'frequency_hz'?"]),
        (["faults.0.amplitude_deg=2"], ["faults.0.amplitude_deg", "at 'valve'", "amplitude_mm"]),
        (["faults.0.at=sensor", "faults.0.kind=ofc_solid"], ["faults.0.amplitude", "needs one of amplitude"]),
        (["faults.0.target=elevator.left_iner"], ["faults.0.target", "Did you mean 'elevator.left_inner'?"]),
        (["faults.0.target=elevator.left_inner.rodd"], ["faults.0.target", "Did you mean 'elevator.left_inner.rod'?"]),
        (["faults.0.target=engine.5"], ["faults.0.target", "engine.4"]),
        (["faults.0.target=sensor.alhpa"], ["faults.0.target", "Did you mean 'sensor.alpha'?"]),
        (["faults.0.target=rudr"], ["faults.0.target", "Did you mean 'rudder'?"]),
        (["faults.0.kind=ofc_gas"], ["faults.0.kind", "is no fault of elevator.left_inner"]),
        (["faults.0.kind=dropout"], ["faults.0.kind", "no fault of elevator.left_inner"]),
        (["faults.0.kind=air_in_oil"], ["faults.0.loss_pct", "needs loss_pct", "above 0 to 100"]),
        (["faults.0.kind=magnet_loss", "faults.0.loss_pct=5"], ["faults.0.kind", "hydraulic actuator", "EMA"]),
        (["faults.0.end_s=5"], ["faults.0.end_s = 5", "above start_s = 12"]),
        (["faults.0.end_s=13", "faults.0.ramp_s=3"], ["faults.0.ramp_s", "longer"]),
        (["faults.0.start_s=-1"], ["faults.0.start_s = -1", "0 to 36000"]),
        (["faults.0.path=observers"], ["faults.0.path", "no path"]),
        (["faults.2.kind=bias"], ["faults.2", "index 0 to 1"]),
        (["faults.x.kind=bias"], ["faults.x", "index 0 to 1"]),
        (["flight.mass_t.x=1"], ["--set flight.mass_t.x=1", "is a value"]),
        (["flight"], ["--set flight", "key=value"]),
        (["faults=3"], ["faults = 3: must be a list"]),
        (["flight=3"], ["flight = 3: must be a table"]),
        (["detectors.enabled=iotsekf"], ['detectors.enabled = "iotsekf": must be a list']),
        (["faults.0.target=3"], ["faults.0.target = 3: must be text"]),
        (["duration_s=0.001"], ["duration_s = 0.001", "less than a tick at 200 Hz", "0.005 to 36000"]),
        (["elevator.left_inner.hydraulic.P_s=1e9"], ["left_inner", "P_s", "out of range; allowed: 2.8e+06 to 7e+07 N"]),
        (["elevator.left_inner.hydraulic.P_z=1"], ["P_z = 1: unknown key for a hydraulic actuator"]),
        (["elevator.left_inner.hydraulic.substeps=3"], ["substeps = 3: unknown key for a hydraulic actuator"]),
        (["elevator.left_inner.hydraulik.P_s=1e7"], ["not one of the choices; allowed: hydraulic, ema, simple"]),
        (["flight.wind_kt=-5"], ["flight.wind_kt = -5", "is out of range", "0 to 250"]),
        (["flight.wind_from_deg=361"], ["flight.wind_from_deg = 361", "0 to 360"]),
        (["flight.shear_kt_1000ft=fast"], ['flight.shear_kt_1000ft = "fast"', "valid number"]),
        (["flight.gusts.0.start_s=3"], ["flight.gusts.0.speed_fps", "is missing"]),
        ([*GUST, "flight.gusts.0.speed_fps=200"], ["flight.gusts.0.speed_fps = 200", "-150 to 150"]),
        ([*GUST, "flight.gusts.0.gradient_ft=1"], ["flight.gusts.0.gradient_ft = 1", "10 to 10000"]),
        ([*GUST, "flight.gusts.0.axis=up"], ['flight.gusts.0.axis = "up"', "vertical, lateral, longitudinal"]),
        ([*GUST, "flight.gusts.0.shape=step"], ['flight.gusts.0.shape = "step"', "1-cosine, ramp"]),
        ([*GUST, "flight.gusts.0.speed_kt=3"], ["flight.gusts.0.speed_kt", "unknown key", "speed_fps"]),
        (["flight.gusts.1.start_s=3"], ["flight.gusts.1 is not in the list", "index 0 to 0"]),
        (["flight.gusts=[" + "{start_s=1, speed_fps=3}," * 17 + "]"], ["flight.gusts"]),
        (["flight.gusts=3"], ["flight.gusts = 3: must be a list"]),
        (["flight.air.0.turbulence=heavy", "flight.air.0.start_s=1"], ['turbulence = "heavy"', "moderate"]),
        (["flight.air.0.turbulence=light"], ["flight.air.0.start_s", "is missing"]),
        (["flight.air=[{start_s=5, turbulence='light'}, {start_s=8, turbulence='none'}]"],
         ["flight.air.1.start_s = 8", "before air.0 is reached", "10 or later", "Order them by time"]),
        (["manoeuvre.kind=nose_up", "manoeuvre.hold_speed=1"], ["manoeuvre.hold_speed = 1", "true or false"]),
        ([*INPUTS, "manoeuvre.time_s=[0, 1]", "manoeuvre.stick=[0]"], ["stick = [0]: has 1 numbers, time_s has 2"]),
        ([*INPUTS, "manoeuvre.time_s=[0, 1]", "manoeuvre.stick=[0, 2]"], ["stick.1 = 2: is out of range"]),
        ([*INPUTS, "manoeuvre.time_s=[0, 1]", "manoeuvre.stick=[0, true]"], ["stick.1 = true: must be a valid number"]),
        ([*INPUTS, "manoeuvre.time_s=[1, 0]", "manoeuvre.stick=[0, 0]"], ["time_s.1 = 0: does not come after 1"]),
        ([*INPUTS, "manoeuvre.time_s=[0, 1]", "manoeuvre.stick=3"], ["stick = 3: must be a list"]),
        ([*INPUTS, "manoeuvre.stick=[0, 0]"], ["time_s: is missing"]),
        ([*INPUTS, "manoeuvre.time_s=[0]", "manoeuvre.throttle=[1]", "manoeuvre.hold_speed=true"],
         ["the table moves the throttles"]),
        ([*INPUTS, "manoeuvre.time_s=[0]", "manoeuvre.stick=[1]", "manoeuvre.wheel=[1]"], ["wheel = [1]: unknown key"]),
    ],
)  # fmt: skip
def test_mistake_is_named_with_place_and_remedy(overrides, says):
    text = refused(*overrides)
    for part in says:
        assert part in text


@pytest.mark.parametrize(
    ("faults", "key", "says"),
    [
        ([{**OFC, "kind": "ofc_solid", "at": "sensor"}], "faults.0.at", "allowed: valve, command"),
        ([fault("elevator.all", "supply_pressure_drop", loss_pct=50.0)], "faults.0.kind", "right_inner is an EMA"),
        ([fault("elevator.right_inner.rod", "bias", bias_mm=1.0)], "faults.0.target", "no sensor 'rod'"),
        ([fault("elevator.left_inner.current", "bias", bias_a=1.0)], "faults.0.target", "no sensor 'current'"),
        ([fault("elevator.left_inner.rod", "bias", bias_mm=1.0, path="observers")], "faults.0.path", "loop, monitor"),
        ([fault("sensor.alpha", "bias", bias_deg=1.0, path="loop")], "faults.0.path", "all, observers"),
        ([fault("sensor.alpha", "bias", bias_kt=1.0)], "faults.0.bias_kt", "bias_deg"),
        ([fault("sensor.alpha", "bias", bias_deg=0.0)], "faults.0.bias_deg", "not 0"),
        ([fault("sensor.alpha", "scale", scale=1.0)], "faults.0.scale = 1.0", "allowed: -10 to 10, not 1"),
        ([fault("sensor.alpha", "bias", bias_deg=-46.0)], "faults.0.bias_deg", "-45 to 45, not 0"),
        ([fault("sensor.alpha", "bias", bias_deg="1")], "faults.0.bias_deg", "must be a valid number"),
        ([fault("sensor.alpha", "freeze", ramp_s=1.0)], "faults.0.ramp_s", "does not support ramp_s"),
        ([fault("rudder", "jam_solid")], "faults.0.kind", "no fault of rudder"),
        ([fault("engine.1", "runaway", rate_deg_s=1.0)], "faults.0.kind", "thrust_loss"),
        ([{**OFC, "amplitude": 0.1}], "faults.0.amplitude_mm", "exclude each other"),
        ([{**OFC, "shape": "saw"}], "faults.0.shape", "sine, square, triangle, chirp"),
        ([{**OFC, "shape": "chirp"}], "faults.0.chirp_hz_s", "needs chirp_hz_s; allowed: -10 to 10"),
        ([{**OFC, "chirp_hz_s": 1.0}], "faults.0.chirp_hz_s", "is for a chirp"),
        ([{**JAM, "shape": "square"}], "faults.0.shape", "has no shape"),
        ([JAM, fault("elevator.left_inner", "free_float")], "faults.1.start_s", "take over"),
        ([fault("sensor.q", "freeze"), fault("sensor.q", "dropout")], "faults.1.start_s", "take over"),
        ([THRUST, {**THRUST, "target": "engine.2"}], "faults.1", "take over"),
        (["ofc"], "faults.0", "a table"),
        ([{"kind": "bias"}], "faults.0.target", "missing"),
    ],
)  # fmt: skip
def test_impossible_combination_is_refused(faults, key, says):
    with pytest.raises(ScenarioError) as caught:
        flight(*faults)
    assert key in str(caught.value) and says in str(caught.value)


def test_faults_on_a_simple_actuator_enter_at_the_command_only():
    simple = {"left_inner": "simple"}
    with pytest.raises(ScenarioError, match="has no valve"):
        flight(OFC, elevator=simple)
    flight({**OFC, "at": "command"}, elevator=simple)
    with pytest.raises(ScenarioError, match="free_float"):
        flight(fault("elevator.left_inner", "free_float"), elevator=simple)


def test_faults_may_follow_each_other_and_act_together():
    first = fault("elevator.left_inner", "jam_solid", end_s=12.0)
    flight(first, {**first, "start_s": 12.0, "end_s": 14.0})
    flight(OFC, {**OFC, "frequency_hz": 2.0}, fault("sensor.alpha", "bias", bias_deg=1.0))


def test_speed_is_needed_once():
    point = {k: v for k, v in POINT.items() if k != "cas_kt"}
    with pytest.raises(ScenarioError, match=r"flight\.cas_kt: the flight needs one of cas_kt, mach, tas_kt"):
        parse({"flight": point})
    with pytest.raises(ScenarioError, match="cas_kt and mach exclude each other"):
        parse({"flight": {**POINT, "mach": 0.5}})


BETWEEN = "faults.0 (ofc_liquid) acts in no tick: they are 0.005 s apart"
RUDDER = ["faults.0.target=rudder", "faults.0.kind=runaway", "faults.0.rate_deg_s=10", "faults.0.limit_deg=-8"]


@pytest.mark.parametrize(("keys", "told"), [
    (["faults.0.start_s=3.001", "faults.0.end_s=3.002"], BETWEEN), (["faults.0.start_s=5.998"], BETWEEN),
    (["faults.0.start_s=3", "faults.0.end_s=3.005"], ""), ([], "12 s, after the flight's end at 6 s"),
    ([*RUDDER, "faults.0.start_s=1"], "drives away from limit_deg = -8"),
    ([*RUDDER, "faults.0.start_s=1", "faults.0.limit_deg=8"], ""),
])  # fmt: skip
def test_what_is_legal_and_probably_not_meant_is_told(keys, told):
    lines = load_scenario("liquid-ofc", ["duration_s=6", *keys]).warnings()
    assert len(lines) == bool(told) and told in "".join(lines)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "flight"),
        (b"[flight\n", "line 1"),
        (b"title = \"a\"\nseed = = 3\n", "line 2"),
        (b"\xff\xfe\x00", "UTF-8"),
        (b"seed = 1\nseed = 2\n", "line 2"),
    ],
)  # fmt: skip
def test_bad_file_is_named(tmp_path, content, says):
    path = tmp_path / "bad.toml"
    path.write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path)
    place, message = str(caught.value).split(": ", 1)
    assert place == str(path) and says in message  # the folder's name holds the case's


@pytest.mark.parametrize(("name", "says"), [
    ("", "no scenario is named"), (".", "folder"), ("no.toml", "no file"), ("liquid-ofcc", "mean 'liquid-ofc'?"),
    ("big.toml", "too large"), ("nul\0byte.toml", "cannot be read"), ("x" * 300, "cannot be read: File name too long"),
])  # fmt: skip
def test_bad_path_is_named(name, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "big.toml").write_bytes(b"#" * 2_000_000)
    with pytest.raises(ScenarioError, match=says):
        load_scenario(name)


@pytest.mark.parametrize("key", ["target", "kind", "at", "path", "shape", "when", "start_s", "amplitude_mm", "?"])
@pytest.mark.parametrize("value", [[], {"a": 1}, [[36000, False]], None, True, 1e400, "", 10**30], ids=repr)
def test_a_value_of_any_type_in_a_fault_is_refused_in_a_line(key, value):
    tables = load_scenario("solid-ofc").model_dump(mode="json", exclude_none=True)
    tables["faults"][0][key] = value
    try:
        parse(tables)
    except ScenarioError as error:
        assert key in str(error)
    else:
        assert (key, value) in [("when", None), ("path", None), ("shape", None), ("at", None)], "was taken"


@pytest.mark.parametrize("part", load_aircraft().travels_deg)
def test_the_limit_of_a_runaway_lies_within_the_travel(part):
    low, high = load_aircraft().travels_deg[part]
    target = {"elevator": "elevator.left_inner", "aileron": "aileron.left"}.get(part, part)
    keys = [f"faults.0.target={target}", "faults.0.rate_deg_s=0.3", *(["faults.0.at=command"] * (part == "elevator"))]
    for limit in (low, high):
        load_scenario("rudder-runaway", [*keys, f"faults.0.limit_deg={limit}"])
        with pytest.raises(ScenarioError, match=f"limit_deg = .*allowed: {low:g} to {high:g}"):
            load_scenario("rudder-runaway", [*keys, f"faults.0.limit_deg={limit * 1.01}"])
