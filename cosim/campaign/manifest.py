"""The manifest of a campaign: what was flown, with which code and seeds, and the SHA-256 of the files of the result."""

import hashlib
import json
import subprocess
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from cosim.campaign.store import fingerprint
from cosim.errors import OutputError
from cosim.files import regular, replace_text
from cosim.scenario.user_file import UserFile

FILE = "manifest.json"
ROOT = Path(__file__).resolve().parents[2]


def about_the_code() -> dict:
    """Return {software, commit, changed, versions}; commit is None outside a checkout, `changed` tells of a source that
    differs from it."""
    said = {"software": f"cosim {version('cosim-fdi')}", "versions": fingerprint()["versions"]}
    if not (ROOT / ".git").exists():
        return {**said, "commit": None, "changed": None}
    commit, changed = _git("rev-parse", "HEAD"), _git("status", "--porcelain", "--untracked-files=no")
    return {**said, "commit": commit or None, "changed": None if changed is None else bool(changed)}


def _git(*words):
    try:
        told = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, timeout=20, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return told.stdout.strip()


def write(out: Path, about: dict, brought: Iterable[tuple[str, UserFile]] = ()) -> None:
    """Write the manifest of a finished campaign into its folder `out`: what it tells of itself (`about`: runs, rows,
    seeds, flights per second of a core), the code, and the user's files that flew, (key, UserFile)."""
    about = {
        **about,
        "digest": fingerprint()["digest"],
        **about_the_code(),
        "user_files": [{"key": key, **file._asdict()} for key, file in brought],
        "sha256": {name: sha256(out / name) for name in ("scenarios.parquet", "runs.parquet")},
    }
    regular(out / FILE, OutputError)
    replace_text(out / FILE, json.dumps(about, indent=1))


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
