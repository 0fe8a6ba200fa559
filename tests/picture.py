"""Take the picture of the report that README.md shows: `python tests/picture.py` (needs chromium)."""

import subprocess
import sys
import tempfile
from pathlib import Path

from cosim.flight.simulate import simulate
from cosim.report import flight_report

sys.path.insert(0, str(Path(__file__).parent / "helpers"))
PICTURE = Path(__file__).resolve().parents[1] / "cosim" / "report" / "report.png"


def main() -> None:
    """Fly the default scenario, write its report and take the first screen of it."""
    from report_browser import CHROMIUM, FLAGS

    if CHROMIUM is None:
        sys.exit("no chromium on this machine")
    with tempfile.TemporaryDirectory() as folder:
        log, page = Path(folder) / "flight.mcap", Path(folder) / "flight.html"
        simulate("liquid-ofc", log=log, achieved=True)
        flight_report(log, page)
        size = ("--window-size=1200,1270", "--virtual-time-budget=10000", f"--screenshot={PICTURE}")
        subprocess.run([CHROMIUM, *FLAGS, *size, page.as_uri()], check=True, capture_output=True, timeout=120)


if __name__ == "__main__":
    main()
