"""Workers end with the process that started them, however it ends; no call is lost when they do."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext

import pytest

import cosim
from actuators import subprocess_env
from cosim.campaign import pool
from cosim.errors import CampaignError

PARENT = """
import os, time
from cosim.campaign.pool import pool
if __name__ == "__main__":
    with pool(2) as workers:
        held = [workers.submit(time.sleep, 600 if {busy} else 0.5) for _ in range(2)]
        while len(workers._processes) < 2:
            time.sleep(0.01)
        print(*workers._processes, flush=True)
        time.sleep(600)
"""


def _alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc; elsewhere by the same code, not shown")
@pytest.mark.parametrize("busy", [True, False])
def test_workers_of_a_killed_campaign_end_at_once(busy, tmp_path):
    (tmp_path / "parent.py").write_text(PARENT.format(busy=busy))
    with subprocess.Popen([sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, text=True) as parent:
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        time.sleep(2.0)  # until they have begun to work, or wait for work again
        assert len(workers) == 2 and all(map(_alive, workers))
        os.kill(parent.pid, signal.SIGKILL)
    end = time.monotonic() + 20
    while any(map(_alive, workers)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(map(_alive, workers))


class _Breaks:
    """A pool whose second call finds it broken, as a worker that was killed between two calls leaves it."""

    def __init__(self, left):
        self.left = left

    def submit(self, function, *arguments):
        if self.left == 0:
            raise BrokenProcessPool("a worker died")
        self.left -= 1
        done = Future()
        done.set_result(function(*arguments))
        return done


def test_a_call_that_finds_the_pool_broken_is_not_lost(monkeypatch):
    pools = iter([_Breaks(1), _Breaks(0), _Breaks(99)])
    monkeypatch.setattr(pool, "pool", lambda workers: nullcontext(next(pools)))
    calls = [(k, abs, (-k,)) for k in range(9)]
    assert sorted(pool.finished(calls, workers=1)) == [(k, k) for k in range(9)]


LIBRARIES = ("signal", "threading", "struct", "pickle", "numpy", "importlib", "json", "jsbsim")
ONE_WORKER = """
import cosim.campaign.pool as p
if __name__ == "__main__":
    with p.pool(1) as workers:
        print(workers.submit(sum, [1, 2]).result())
"""


def test_a_worker_does_not_import_from_the_current_folder(tmp_path):
    where = tmp_path / "where"
    where.mkdir()
    for name in LIBRARIES:
        (where / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\nraise SystemExit(1)")
    (tmp_path / "parent.py").write_text(ONE_WORKER)
    env = {k: v for k, v in subprocess_env.surroundings().items() if k != "PYTHONSAFEPATH"}
    command = [sys.executable, tmp_path / "parent.py"]
    told = subprocess.run(command, env=env, cwd=where, capture_output=True, text=True, timeout=60)
    assert not (tmp_path / "ran").exists(), (tmp_path / "ran").read_text()
    assert told.stdout == "3\n", told.stderr


def test_a_process_of_ours_does_not_import_from_the_current_folder(tmp_path):
    for name in LIBRARIES:
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not asked for')")
    code = f"import {', '.join(LIBRARIES)}, cosim; print(cosim.__file__)"
    told = subprocess.run(
        subprocess_env.command(code), env=subprocess_env.surroundings(), cwd=tmp_path, capture_output=True, text=True
    )
    assert told.stdout.strip() == cosim.__file__, told.stderr


def test_what_the_parents_path_holds_is_there_for_a_worker(tmp_path, monkeypatch):
    (tmp_path / "beside_a_detector.py").write_text("def limit(): return 7")
    monkeypatch.syspath_prepend(str(tmp_path))
    from beside_a_detector import limit

    with pool.pool(1) as workers:
        assert workers.submit(limit).result() == 7


def test_without_locks_between_processes_a_line_says_so(monkeypatch):
    def none(*given, **how):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(pool.cf, "ProcessPoolExecutor", none)
    with pytest.raises(CampaignError, match="/dev/shm"), pool.pool(2):
        pass
