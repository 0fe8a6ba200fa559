"""What the campaigns of hostile cases share: so many cases of a kind through every door, in bounded time and memory."""

import os
import random
import resource
import signal
import traceback
from contextlib import contextmanager, suppress
from pathlib import Path

from hostile_texts import encoded, mangled

from cosim.errors import CosimError

CASES, SEED = int(os.environ.get("COSIM_CASES", "1000")), int(os.environ.get("COSIM_SEED", "0"))
LONGEST_S, LARGEST = 20, 1 << 30


@contextmanager
def bounded(seconds=LONGEST_S, most=LARGEST):
    """Let what is done take no more time of the processor [s], and no more memory than that above what the process
    holds; yields a list with the latter [byte]."""
    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, _too_long)
    _forget_peak()  # what making the case took is not the readers'
    before, used = _peak(), [0]
    signal.setitimer(signal.ITIMER_PROF, seconds)  # of this process: others may keep the machine busy
    signal.alarm(int(60 * seconds))  # for what waits
    try:
        yield used
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
        used[0] = _peak() - before
    assert used[0] < most, f"{used[0] / 1e6:.0f} MB"


def tried(kind, n, make, doors):
    """Send `n` cases of `make(rng)` through every door; print what came of them."""
    taken = refused = 0
    failed = {}
    for number in range(SEED, SEED + n):
        case = make(random.Random(f"{kind} {number}"))
        for door in doors:
            try:
                with bounded():
                    door(case)
                taken += 1
            except CosimError as error:
                refused += 1
                assert "\n" not in str(error)
            except (Exception, TooLongError) as error:  # one of each place is told
                where = traceback.extract_tb(error.__traceback__)
                last = [f"{Path(f.filename).name}:{f.lineno}" for f in where if "/cosim/" in f.filename][-1:]
                failed.setdefault((type(error).__name__, *last), f"{kind} {number}: {error!r:.300}")
    print(f"\n{kind}: {n} cases, {taken} taken, {refused} refused")
    assert not failed, "\n".join(f"{' '.join(place)}: {told}" for place, told in failed.items())


def _forget_peak():
    """Let the largest memory of this process count from now on, where the system can (Linux)."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak():
    """Return the largest memory of this process [bytes]."""
    with suppress(OSError):
        return 1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class TooLongError(BaseException):
    """What no reader catches."""


def _too_long(*_):
    raise TooLongError(f"takes longer than {LONGEST_S} s")


def written(path, originals):
    """Return what writes a mangled one of `originals` to `path`."""

    def make(rng):
        path.write_bytes(encoded(rng, mangled(rng, rng.choice(originals))))
        return path

    return make
