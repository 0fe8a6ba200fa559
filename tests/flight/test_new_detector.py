"""A new detector is one file and one line: it flies, is logged, replays, is compared and stands in every list."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINE = '    "ofc_monitor": "fdi.monitors.ofc_monitor",\n'
TOUCHED = {
    "fdi/monitors/template.py": (ROOT / "tests/data/template_detector.py").read_text(),
    "fdi/registry.py": (ROOT / "fdi/registry.py")
    .read_text()
    .replace(LINE, LINE + '    "template": "fdi.monitors.template",\n'),
}
USE = """
import json, cosim
from cosim.campaign.inventory import inventory
from cosim.compare import compare
from cosim.replay import replay
only = ["duration_s=4", "detectors.enabled=['template', 'ofc_monitor']", "elevator.feedback=measured",
        "detectors.template.threshold=0.005",
        "faults.0={target='elevator.left_inner.rod', kind='bias', bias_mm=12, start_s=1.5, path='monitor'}"]
run = cosim.simulate(cosim.load_scenario("cruise", only), log="a.mcap", timed=False).to_dict()
own = next(d for d in run["detectors"] if d["id"] == "template" and d["target"] == "elevator.left_inner")
again = replay("a.mcap")
table = compare(["a.mcap"])
topic = cosim.open_log("a.mcap").topics["/detectors/template/left_inner"]
fields = dict(zip(topic.fields, topic.units))
print(json.dumps({
    "own": own, "exact": again.exact, "replayed": [d["id"] for d in again.detectors], "fields": fields,
    "compared": table.to_dict()["detectors"],
    "listed": [d["id"] for d in inventory()["detectors"]]}))
"""


def test_a_detector_is_one_file_and_one_line(tmp_path):
    for name in ("actuators", "fdi", "cosim", "aircraft"):
        shutil.copytree(ROOT / name, tmp_path / name)
    for name, text in TOUCHED.items():
        (tmp_path / name).write_text(text)
    done = subprocess.run([sys.executable, "-c", USE], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    own = found["own"]
    assert own["isolated"] == {"class": "sensor", "target": "elevator.left_inner.rod"} and not own["false_alarms"]
    assert own["estimate_unit"] == "m" and abs(own["estimate_bias"]) < 0.001
    assert found["exact"] and "template" in found["replayed"] and "template" in found["listed"]
    assert found["fields"] == {"f_hat": "m", "r": "-", "alarm": "-", "verdict": "-", "culprit": "-", "valid": "-"}
    assert [d["detected"] for d in found["compared"] if d["id"] == "template"] == [1]
    assert len(TOUCHED) == 2
