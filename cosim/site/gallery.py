"""The gallery: every example run as it stands, with a figure of what it has made."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "cosim" / "examples"
START = "import matplotlib.pyplot as plt\n"

# Per example: a line below its figure, and what draws it from the names and files that the example leaves.
FIGURES: dict[str, tuple[str, str]] = {
    "fly_and_plot": ("Inner left elevator, and the residuals of a local and an aircraft-level detector.", """
f, ax = plt.subplots(2, 1, sharex=True, figsize=(7.2, 4))
ax[0].plot(truth.index, truth["de_li"] * 57.3)
ax[0].set_ylabel("elevator [deg]")
for topic in ("/detectors/iotsekf/left_inner", "/detectors/rfafe/aircraft"):
    r = log.frame(topic)["r"]
    ax[1].plot(r.index, r, label=topic.split("/")[2])
ax[1].axhline(1.0, color="k", ls=":")
ax[1].set(xlabel="time [s]", ylabel="residual / threshold")
ax[1].legend()
"""),
    "own_fault": ("The same fault, three sizes, at the surface.", """
f, ax = plt.subplots()
for amplitude_mm in (8.0, 2.0, 0.5):
    keys = [f"faults.0.{key}={value}" for key, value in {**FAULT, "amplitude_mm": amplitude_mm}.items()]
    flown = cosim.fly(cosim.load_scenario("cruise", ["duration_s=12", "flight.turbulence=none", *keys]),
                      ["truth.aircraft.de_li"])
    ax.plot(flown.index, flown.iloc[:, 0] * 57.3, label=f"{amplitude_mm} mm")
ax.set(xlabel="time [s]", ylabel="elevator [deg]")
ax.legend()
"""),
    "linear_model": ("Open loop of the pitch-rate feedback.", """
w = np.geomspace(0.05, 50.0, 400)
response = control.frequency_response(loop, w).complex.squeeze()
f, ax = plt.subplots(2, 1, sharex=True, figsize=(7.2, 4))
ax[0].semilogx(w, 20 * np.log10(abs(response)))
ax[0].set_ylabel("magnitude [dB]")
ax[1].semilogx(w, np.degrees(np.unwrap(np.angle(response))))
ax[1].set(xlabel="frequency [rad/s]", ylabel="phase [deg]")
"""),
    "replay_csv": ("The recorded table, and when each detector first alarmed.", """
table = pd.read_csv("bench.csv")
f, ax = plt.subplots()
ax.plot(table["clock_ms"] / 1e3, table["ELEV_CMD_DEG"], label="ELEV_CMD_DEG")
ax.plot(table["clock_ms"] / 1e3, table["SURF_DEG"], label="SURF_DEG")
for i, d in enumerate(d for d in found.detectors if d["first_alarm_s"] is not None):
    ax.axvline(d["first_alarm_s"], color=f"C{i + 2}", ls="--", label=d["id"])
ax.set(xlabel="time [s]", ylabel="[deg]")
ax.legend()
"""),
    "own_detector": ("Residual and alarm of the detector that was registered.", """
own = cosim.open_log("own_detector.mcap").frame("/detectors/parity/left_inner")
f, ax = plt.subplots()
ax.plot(own.index, own["r"], label="r")
ax.plot(own.index, own["alarm"], label="alarm")
ax.set(xlabel="time [s]")
ax.legend()
"""),
    "window_model": ("Windows that the forest has learned from, in two of its features.", """
x, label = np.concatenate(rows), np.concatenate(labels)
f, ax = plt.subplots()
for value, name in ((0, "none"), (1, "ofc_liquid")):
    ax.loglog(1e3 * x[label == value, 0], x[label == value, 1], ".", label=name)
ax.set(xlabel="swing of the rod [mm]", ylabel="swing of the valve command [1]")
ax.legend()
"""),
    "own_actuator": ("One elevator segment, moved by the shipped actuator and by the lag.", """
f, ax = plt.subplots()
for name, changes in (("hydraulic", shipped), ("lag", mine)):
    flown = cosim.fly(cosim.load_scenario("cruise", changes), seen)[seen[0]]
    ax.plot(flown.index, flown * 57.3, label=name)
ax.set(xlabel="time [s]", ylabel="elevator [deg]")
ax.legend()
"""),
    "own_law": ("Load factor under three laws.", """
f, ax = plt.subplots()
for name, changes in laws.items():
    flown = cosim.fly(cosim.load_scenario("cruise", [*flight, *changes]), ["truth.aircraft.nz"])
    ax.plot(flown.index, flown.iloc[:, 0], label=name)
ax.set(xlabel="time [s]", ylabel="n_z [g]")
ax.legend()
"""),
    "step_by_hand": ("What was flown: jammed at 5 s, healed when the loop ended.", """
rods = cosim.open_log("by-hand.mcap").frame("/sensors/left_inner")["rod"]
f, ax = plt.subplots()
ax.plot(rods.index, 1e3 * rods)
ax.set(xlabel="time [s]", ylabel="rod [mm]")
"""),
    "climb_and_turn": ("Climb, bank, and a descending turn: each flight stays as it was trimmed.", """
f, ax = plt.subplots(2, 1, sharex=True, figsize=(7.2, 4))
for start in (["flight.climb_fpm=1000"], ["flight.bank_deg=30"], ["flight.turn_deg_s=1.5", "flight.gamma_deg=-1"]):
    flown = cosim.fly(cosim.load_scenario("cruise", [*keys, *start]), ["truth.aircraft.h", "truth.aircraft.phi"])
    h, phi = flown["truth.aircraft.h"], flown["truth.aircraft.phi"]
    ax[0].plot(flown.index, h - h.iloc[0], label=", ".join(start))
    ax[1].plot(flown.index, phi * 57.3)
ax[0].set_ylabel("altitude gained [m]")
ax[0].legend(fontsize=7)
ax[1].set(xlabel="time [s]", ylabel="bank [deg]")
"""),
    "own_inputs": ("What the stick, throttle and stabiliser of the table do.", """
f, ax = plt.subplots(2, 1, sharex=True, figsize=(7.2, 4))
ax[0].plot(flight.index, flight["truth.aircraft.nz"])
ax[0].set_ylabel("n_z [g]")
ax[1].plot(flight.index, flight["truth.aircraft.phi"] * 57.3)
ax[1].set(xlabel="time [s]", ylabel="bank [deg]")
"""),
    "campaign": ("How long each detector took to see the oscillation; no dot where it was missed.", """
f, ax = plt.subplots()
for k, (name, own) in enumerate(rows[rows["concerned"].astype(bool)].groupby("id")):
    ax.semilogy(own["faults.0.amplitude_mm"] * (0.97 + 0.03 * k), own["delay_s"], "o", label=name)
ax.set(xlabel="amplitude [mm]", ylabel="first alarm after [s]")
f.legend(loc="outside right upper")
"""),
    "data_set": ("Rod position in the flights of the split 'train'.", """
f, ax = plt.subplots()
for name, one in frame.groupby("file"):
    ax.plot(one["t_s"] if "t_s" in one else one.index, 1e3 * one["left_inner.rod"], label=name)
ax.set(xlabel="time [s]" if "t_s" in frame else "sample", ylabel="rod [mm]")
ax.legend(fontsize=7)
"""),
}  # fmt: skip


def title(name: str) -> str:
    """Return the heading of an example."""
    return name.replace("_", " ").capitalize()


def pages() -> list[tuple[str, str]]:
    """Return [(place on the site, Markdown)] of all examples, ready to be executed."""
    return [*map(example, sorted(p.stem for p in EXAMPLES.glob("*.py")))]


def example(name: str) -> tuple[str, str]:
    """Return the page of an example: its docstring, its code, what it prints, a figure of what it made."""
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    words = ast.get_docstring(ast.parse(text)) or ""
    caption, code = FIGURES[name]
    run = f'```python run="{name}.py"\n{text}```\n'
    figure = f'```python figure="{caption}"\n{START}{code}```\n'
    copied = f"`cosim new example {name}` copies this program into your folder."
    return f"gallery/{name}.md", f"# {title(name)}\n\n{words}\n\n{copied}\n\n{run}\n{figure}"


def index(docs: Path) -> str:
    """Return the gallery's first page: a card per page, with its last figure."""
    cards = []
    for place, text in pages():
        stem = Path(place).stem
        figures = sorted((docs / "gallery").glob(f"{stem}-*.svg"), key=lambda p: int(p.stem.rpartition("-")[2]))
        words = text.split("\n\n")[1].splitlines()[0]
        head = text.split("\n")[0].removeprefix("# ")
        picture = f"    [![{head}]({figures[-1].name})]({stem}.md)\n\n" if figures else ""
        cards.append(f"-   **[{head}]({stem}.md)**\n\n{picture}    {words}\n")
    told = "Every program of `cosim list examples`, run when this site was built."
    return f'# Gallery\n\n{told}\n\n<div class="grid cards" markdown>\n\n' + "\n".join(cards) + "\n</div>\n"
