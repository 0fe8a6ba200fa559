"""From the flight point of a scenario to that of the plant."""


def plant_flight(scenario):
    """Return the `cosim.plant.Flight` (SI) of `scenario`: point, multipliers of coefficients, turbulence, seed."""
    from cosim.plant import Flight

    f = scenario.flight
    kind, speed = f.speed
    return Flight(
        mass=f.mass,
        cg=f.cg,
        altitude=f.altitude,
        speed_kind=kind,
        speed=speed,
        multipliers=dict(scenario.tolerances.aero),
        turbulence=f.turbulence,
        seed=scenario.seed,
    )
