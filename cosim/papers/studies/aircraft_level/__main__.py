"""`python -m cosim.papers.studies.aircraft_level PART [-o FOLDER] [--workers N] [--json] [...]`."""

import argparse
import json
import sys
from pathlib import Path

from cosim.files import replace_text
from cosim.papers.studies.aircraft_level import PARTS, run


def main():
    """Run one part and print its tables, or one JSON object; progress goes to standard error."""
    text = "parts:\n" + "\n".join(f"  {name:11s} {what}" for name, what in PARTS.items())
    parser = argparse.ArgumentParser(
        prog="python -m cosim.papers.studies.aircraft_level", epilog=text,
        formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=PARTS, metavar="PART")
    parser.add_argument("-o", "--output", type=Path, default=None, help="folder of results; a run goes on from there")
    parser.add_argument("--workers", type=int, default=2, help="processes; 0: none but this one")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--draws", type=int, default=None, help="uncertain, redundancy, smallest: draws per case")
    parser.add_argument("--seeds", type=int, default=None, help="ofc, corners: seeds per case")
    parser.add_argument("--all-frequencies", action="store_true", help="ofc: seven frequencies instead of four")
    parser.add_argument("--judge-only", action="store_true", help="thresholds: do not train")
    given = parser.parse_args()
    options = {name: getattr(given, name) for name in ("draws", "seeds") if getattr(given, name) is not None}
    if given.part == "ofc" and given.all_frequencies:
        from cosim.papers.studies.aircraft_level.ofc import ALL_HZ

        options["hz"] = ALL_HZ
    if given.part == "thresholds":
        options["train"] = not given.judge_only
    if given.output:
        given.output.mkdir(parents=True, exist_ok=True)
    tables = run(given.part, out=given.output, workers=given.workers, progress=_progress, **options)
    print(file=sys.stderr)
    plain = [t.plain() for t in tables]
    if given.output:
        path = given.output / f"{given.part}.json"
        replace_text(path, json.dumps(plain, indent=1) + "\n")
    if given.json:
        print(json.dumps(plain))
    else:
        print("\n\n".join(t.text() for t in tables))


def _progress(done, total):
    print(f"\r{done} of {total}", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
