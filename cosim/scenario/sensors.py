"""[sensors]: what a sensor deviates in from its set."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from cosim.scenario import catalog as c
from cosim.scenario.problem import Mistakes, Table, choice, known_keys


@dataclass(frozen=True)
class SensorSetting:
    """A sensor's own deviations from its set, in its own unit; None means as in the set. `scale` is the error (0 is
    exact).
    """

    sigma: float | None = None
    bias: float | None = None
    scale: float | None = None
    delay: float | None = None
    quantum: float | None = None


class Sensors(Table, extra="allow"):
    """The sensor set, and a table per sensor that deviates from it."""

    __pydantic_extra__: dict[str, dict[str, float]]
    set: Literal["transport"] = "transport"
    noise_scale: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0
    reconstructed: bool = False  # the law flies on n_z and alpha less what lpv_smo estimates of faults

    @model_validator(mode="after")
    def _known(self):
        units, wrong = {**c.SENSORS, **c.ACTUATOR_SENSORS}, Mistakes()
        for name, table in (self.model_extra or {}).items():
            with wrong.caught():
                if name not in units:
                    raise choice(name, units, "sensor", key=name)
                keys = _sensor_keys(units[name])
                for key, value in table.items():
                    if key in keys and not keys[key].accepts(value):
                        wrong.add("is out of range", key=f"{name}.{key}", allowed=keys[key].range)
                known_keys(table, keys, f"{name}.")
        wrong.check()
        return self

    def setting(self, name: str, own: Any = lambda unit: 1.0) -> SensorSetting:
        """Return the SensorSetting of sensor `name`; `own(unit)` is what one SI `unit`, or share of a nominal value
        ("of supply", ...), is in the sensor's own unit.
        """
        table = (self.model_extra or {}).get(name, {})
        keys = _sensor_keys({**c.SENSORS, **c.ACTUATOR_SENSORS}[name])
        values = {k.split("_")[0]: v * keys[k].factor * own(keys[k].si) for k, v in table.items()}
        if "scale" in values:
            values["scale"] -= 1.0
        return SensorSetting(**values)


def _sensor_keys(units):
    keys = [c.Key("scale", 0.5, 2.0), c.Key("delay_s", 0.0, 0.15, 1.0, "s")]
    for u in units:
        keys += [
            c.Key(f"sigma_{u.suffix}", 0.0, u.limit, u.factor, u.si),
            c.Key(f"bias_{u.suffix}", -u.limit, u.limit, u.factor, u.si),
            c.Key(f"quantum_{u.suffix}", 0.0, u.limit, u.factor, u.si),
        ]
    return {k.name: k for k in keys}
