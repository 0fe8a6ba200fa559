"""What a flight's log holds: topics for everything of a tick, and as attachments what replay needs."""

import io
import json

import numpy as np

from cosim.flight import detectors, wiring
from cosim.flight.blocks import faults, hinge_model, law, sensors
from cosim.flight.units import unit
from cosim.log import LogWriter, Pose, Topic, viewer_layouts
from cosim.scenario.catalog import SEGMENTS

SNAPSHOT_S = 1.0  # hidden detector states are logged that often
LARGE = 1 << 18  # [byte] larger parameters are compressed: tables of a force model


def _sensor_copies(scenario):
    """Return {topic prefix: (value, flag)}: the observers' copy is logged beside the law's only where a fault can part
    them.
    """
    own = any(j.path in ("observers", "monitor") for j in scenario.injections())
    return {"/sensors": ("y", "valid"), **({"/observers": ("y_obs", "valid_obs")} if own else {})}


def topics(setup):
    """Return the log's topics: everything of a tick, under names that a reader understands."""
    bus, out = setup.loop.bus, []

    def add(name, columns, group, every=1):
        if columns:
            fields = tuple(_field(c) for c, _ in columns)
            index = np.array([i for _, i in columns])
            units = tuple("-" if name == "/noise" else unit(group, f) for f in fields)
            out.append(Topic(name=name, fields=fields, units=units, index=index, every=every, group=group))

    add("/truth/aircraft", bus.columns("truth", "aircraft"), "truth")
    add("/surfaces/aircraft", bus.columns("surfaces", "aircraft"), "truth")
    for prefix, (y, valid) in _sensor_copies(setup.scenario).items():
        add(
            f"{prefix}/aircraft",
            [
                (n + tail, bus.index(f"sensors.{n}.{f}"))
                for tail, f in (("", y), ("_valid", valid))
                for n in sensors.TRANSPORT
            ],
            "sensors",
        )
        for seg in SEGMENTS:
            names = wiring.ACTUATOR_SENSORS[setup.scenario.elevator.technology[seg]]
            add(
                f"{prefix}/{seg}",
                [
                    (n + tail, bus.index(f"sensors.{seg}_{n}.{f}"))
                    for tail, f in (("", y), ("_valid", valid))
                    for n in names
                ],
                "sensors",
            )
    add("/noise", [(lane, bus.index(f"sensors_in.{lane}.noise")) for lane in bus.lanes["sensors"]], "sensors")
    add("/pilot", bus.columns("pilot", "pilot"), "law")
    add("/law", bus.columns("law", "law", law.OUTPUTS), "law")
    for seg in SEGMENTS:
        add(f"/hinge_model/{seg}", bus.columns("hinge_model", seg, hinge_model.OUTPUTS), "detectors")
    for b in (*setup.loop.servos, *setup.loop.actuators):
        for lane in bus.lanes[b.name]:
            held = [("u_held", bus.index(f"{b.name}_in.{lane}.u"))] if "u" in b.module.INPUTS.names else []
            add(f"/actuators/{lane}/{b.name}", bus.columns(b.name, lane, b.module.OUTPUTS) + held, "actuators")
    for lane in setup.lanes:
        add(f"/faults/f{lane.name}", bus.columns("faults", lane.name, faults.OUTPUTS), "faults")
    for d in setup.loop.detectors:
        for lane in bus.lanes[d.name]:
            add(f"/detectors/{d.name}/{lane}", bus.columns(d.name, lane, d.module.OUTPUTS), "detectors", d.every)
            hidden = [n for n in d.module.STATE.names if n not in d.module.OUTPUTS]
            every = max(1, round(SNAPSHOT_S / setup.loop.dt / d.every)) * d.every
            add(f"/state/{d.name}/{lane}", bus.columns(d.name, lane, hidden), "snapshot", every)
    return out


def open_writer(setup, path):
    """Return the LogWriter of a flight's log, with what does not change written: scenario, parameters, wiring."""
    import cosim

    loop, channels = setup.loop, topics(setup)
    blocks = [loop.sensors, loop.pilot, loop.law, loop.hinge, *loop.detectors, *loop.servos, *loop.actuators]
    attachments = {
        "scenario.toml": ("application/toml", setup.scenario.expanded_toml().encode()),
        "detectors.json": (
            "application/json",
            json.dumps(detectors.manifest(setup, channels), indent=1, sort_keys=True).encode(),
        ),
    }
    for b in blocks:
        attachments |= _array(f"{b.name}.params", b.p) | _array(f"{b.name}.initial", b.x)
    attachments |= viewer_layouts(channels)
    metadata = {
        "run": {
            "title": setup.scenario.title,
            "software": f"cosim {cosim.__version__}",
            "rate_hz": str(setup.scenario.rate_hz),
            "seed": str(setup.scenario.seed),
            "ticks": str(setup.ticks),
        },
        "trim": {k: repr(v) for k, v in vars(setup.trim).items() if isinstance(v, float)},
        "libraries": {"jsbsim": _version("jsbsim"), "numpy": np.__version__, "numba": _version("numba")},
    }
    writer = LogWriter(
        path,
        channels,
        n_values=len(loop.v),
        dt_ns=round(loop.dt * 1e9),
        metadata=metadata,
        attachments=attachments,
        pose=pose(loop.bus),
    )
    for f in setup.scenario.faults:
        start, end = (None if t is None else round(t * setup.scenario.rate_hz) for t in (f.start_s, f.end_s))
        writer.window(start, start, end, kind=f.kind, target=f.target)
    return writer


def open_live(setup, port):
    """Return the server that shows the topics of a flight's log while it is flown."""
    from cosim.log.live import Live

    loop = setup.loop
    return Live(topics(setup), dt_ns=round(loop.dt * 1e9), pose=pose(loop.bus), port=port, name=setup.scenario.title)


def pose(bus):
    """Return where in the bus the aircraft's place stands."""
    return Pose(**{n: bus.index(f"truth.aircraft.{n}") for n in ("lat", "lon", "h", "phi", "theta", "psi")})


def result_texts(result):
    """Return the result's texts for the log: nothing in them depends on the machine's clock."""
    kept = [{k: v for k, v in d.items() if k != "step_us"} for d in result.to_dict()["detectors"]]
    return {
        "status": result.status,
        "reason": result.reason,
        "sim_time_s": repr(result.sim_time_s),
        "detectors": json.dumps(kept, sort_keys=True),
        "achieved": json.dumps(result.extra.get("achieved"), sort_keys=True),
    }


def _array(name, array):
    """Return {attachment: (media type, bytes)} of an array: .npy, or .npz with it as `array` when it is large."""
    out = io.BytesIO()
    if array.nbytes > LARGE:
        np.savez_compressed(out, array=array)
        return {f"{name}.npz": ("application/zip", out.getvalue())}
    np.save(out, array, allow_pickle=False)
    return {f"{name}.npy": ("application/x-npy", out.getvalue())}


def _version(name):
    from importlib.metadata import version

    return version(name)


def _field(name):
    """Return a column's name as a log field: x_hat[2] is x_hat_2."""
    return name.replace("[", "_").replace("]", "")
