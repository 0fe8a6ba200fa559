"""Take the linear model of the aircraft at a flight point into python-control: pip install control."""

import control
import numpy as np

import cosim

model = cosim.linearize(cosim.load_scenario("cruise", ["flight.mass_t=260", "flight.cas_kt=270"]))
for mode in model.modes:
    print(f"{mode.name:13} {mode.wn:7.4f} rad/s, damping {mode.zeta:6.3f}")

# the short period alone: angle of attack and pitch rate, all four elevator segments together
elevators = ["de_lo", "de_li", "de_ri", "de_ro"]
airframe = model.to_control(["alpha", "q"], elevators, ["q", "nz"]) * np.ones((len(elevators), 1))
print(control.poles(airframe))

# an elevator as a lag of 0.1 s, 0.1 s of delay, and pitch rate fed back
elevator = control.tf([1.0], [0.1, 1.0]) * control.tf(*control.pade(0.1, 3))
loop = airframe[0, 0] * elevator * -1.5  # trailing edge down is +, and pitches down
gain_margin, phase_margin, *_ = control.margin(loop)
print(f"gain margin {20 * np.log10(gain_margin):.1f} dB, phase margin {phase_margin:.0f} deg")
