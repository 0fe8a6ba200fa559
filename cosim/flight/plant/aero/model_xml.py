"""Write the JSBSim files of an estimated aircraft that hold no aerodynamics: the model itself and its surfaces."""

from typing import Any

import numpy as np

from cosim.scenario.aircraft import Aircraft


def model_xml(n: Any, aircraft: Aircraft) -> str:
    """Return <name>.xml: metrics, masses, engines and tank, from the `numbers` of the aircraft and its record."""
    g, m, station = aircraft.geometry, aircraft.mass, aircraft.geometry.station_in
    weight = m.empty_t * 1e3
    inertia = "\n".join(
        f'    <i{k} unit="KG*M2"> {v * weight:.1f} </i{k}>' for k, v in m.gyration2_m2
    )
    each = (m.mass_t[0] - m.empty_t - m.fuel_t) * 1e3 / 6
    masses = "\n".join(
        f'    <pointmass name="{name}"> <weight unit="KG"> {each:.1f} </weight>'
        f' <location unit="IN"> <x> {station} </x> <y> 0.0 </y> <z> 0.0 </z> </location> </pointmass>'
        for name in ("fore", "aft", "left", "right", "low", "high")
    )
    sides = np.linspace(-1.0, 1.0, aircraft.engines)
    engines = "\n".join(
        f"""    <engine file="turbofan">
      <feed> 0 </feed>
      <thruster file="direct">
        <location unit="IN"> <x> {station} </x> <y> {s * n.engine.station_m / 0.0254:.2f} </y>
          <z> {-n.engine.below_m / 0.0254:.2f} </z> </location>
        <orient unit="DEG"> <roll> 0.0 </roll> <pitch> {n.engine.pitch_deg} </pitch> <yaw> 0.0 </yaw> </orient>
      </thruster>
    </engine>"""
        for s in sides
    )
    point = f"<x> {station} </x> <y> 0.0 </y> <z> 0.0 </z>"
    return f"""<?xml version="1.0"?>
<!-- Written by cosim.flight.plant.aero.estimate {aircraft.name}: {aircraft.title} -->
<fdm_config name="{aircraft.name}" version="2.0" release="BETA">

  <fileheader>
    <author> cosim </author>
    <license licenseName="MIT" licenseURL="https://opensource.org/license/mit"/>
    <description> {aircraft.title}; clean, airborne only (no landing gear, no flaps) </description>
  </fileheader>

  <metrics>
    <wingarea unit="FT2"> {g.wing_area_ft2} </wingarea>
    <wingspan unit="FT"> {g.span_ft} </wingspan>
    <chord unit="FT"> {g.chord_ft} </chord>
    <location name="AERORP" unit="IN"> {point} </location>
    <location name="EYEPOINT" unit="IN"> {point} </location>
    <location name="VRP" unit="IN"> {point} </location>
  </metrics>

  <!-- Six point masses and the tank carry what is not empty; cosim keeps the radii of gyration -->
  <mass_balance negated_crossproduct_inertia="false">
{inertia}
    <emptywt unit="KG"> {weight} </emptywt>
    <location name="CG" unit="IN"> {point} </location>
{masses}
  </mass_balance>

  <propulsion>
{engines}
    <tank type="FUEL" number="0">
      <location unit="IN"> {point} </location>
      <capacity unit="KG"> {m.fuel_t * 1e3} </capacity>
      <contents unit="KG"> {m.fuel_t * 1e3} </contents>
    </tank>
  </propulsion>

  <ground_reactions/>

  <system file="multipliers"/>
  <system file="surfaces"/>

  <aerodynamics file="aerodynamics"/>

</fdm_config>
"""


def surfaces_xml(aircraft: Aircraft) -> str:
    """Return the system that takes surfaces from outside when ext/engaged is 1, else from JSBSim's own commands."""
    segments, stops = tuple(aircraft.short.values()), aircraft.travels
    outside = [*(f"elevator-{s}" for s in segments), "aileron-left", "aileron-right", "rudder", "stabilizer"]
    inputs = [*(f"ext/{name}-rad" for name in outside), *(f"ext/gust-{rate}-rad_sec" for rate in "pqr")]
    commands = (("elevator", "elevator", "elevator"), ("stabilizer", "pitch-trim", "stabiliser"),
                ("aileron", "aileron", "aileron"), ("rudder", "rudder", "rudder"))  # fmt: skip
    scales = "\n".join(
        f"""    <aerosurface_scale name="fcs/{name}-cmd-rad">
      <input> fcs/{source}-cmd-norm </input>
      <range> <min> {stops[kind][0]:.5f} </min> <max> {stops[kind][1]:.5f} </max> </range>
    </aerosurface_scale>"""
        for name, source, kind in commands
    )
    positions = {f"elevator-{s}": (f"elevator-{s}-pos", "elevator") for s in segments}
    positions |= {"aileron-left": ("aileron-left-pos", "aileron"), "aileron-right": ("aileron-right-pos", "aileron"),
                  "rudder": ("rudder-applied", "rudder"), "stabilizer": ("stabilizer-pos", "stabilizer")}  # fmt: skip
    switches = "\n".join(
        f"""    <switch name="fcs/{name}-rad">
      <default value="fcs/{command}-cmd-rad"/>
      <test value="ext/{source}-rad"> ext/engaged eq 1 </test>
    </switch>"""
        for source, (name, command) in positions.items()
    )
    properties = "\n".join(f'  <property value="0"> {name} </property>' for name in ("ext/engaged", *inputs))
    return f"""<?xml version="1.0"?>
<!-- Surface positions: from outside when ext/engaged is 1, else from the plain JSBSim commands without lag.
     Signs: elevator and stabiliser trailing edge down +; each aileron + rolls right; rudder + yaws left. -->
<system name="surfaces">

{properties}

  <channel name="commands">
{scales}
  </channel>

  <channel name="positions">
{switches}
  </channel>

</system>
"""
