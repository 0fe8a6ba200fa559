"""Fly a scenario, look at its log with pandas, and plot what the detectors saw.

Writes flight.mcap and flight.html, which opens in a browser.
"""

import cosim

scenario = cosim.load_scenario("liquid-ofc", ["duration_s=20", "flight.turbulence=light"])
result = cosim.simulate(scenario, log="flight.mcap")
print(result)

log = cosim.open_log("flight.mcap")
truth = log.frame("/truth/aircraft")  # a DataFrame, index t_s in seconds, SI and radians
print(truth[["alpha", "q", "nz", "de_li"]].describe())
print("units:", truth.attrs["units"]["alpha"], truth.attrs["units"]["nz"])

drawn = truth[["de_li"]].copy()  # the left inner elevator, and how two detectors judge it
drawn["iotsekf"] = log.frame("/detectors/iotsekf/left_inner")["r"]
drawn["rfafe"] = log.frame("/detectors/rfafe/aircraft")["r"]
drawn.plot(backend="plotly", facet_row="variable").update_yaxes(matches=None).write_html("flight.html")
