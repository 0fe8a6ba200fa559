"""Compile every kernel that ships into actuators/objects of this checkout, for the wheel."""

import shutil

from actuators.object_cache import SHIPPED, target
from actuators.precompile import compile_ahead
from cosim.flight.loop.compiling import every

if not target().startswith("linux-"):
    raise SystemExit(f"objects ship for Linux on x86-64; this is {target()}")
wanted = every()
compile_ahead(wanted, lambda done, total: print(f"\rcompiled {done} of {total}", end="", flush=True))
shutil.rmtree(SHIPPED, ignore_errors=True)
(SHIPPED / target()).mkdir(parents=True)
for native in wanted:
    file = native.file()
    if file is None or not native.ready():
        raise SystemExit(f"{native.name} is not compiled")
    (SHIPPED / target() / file.name).write_bytes(file.read_bytes())
print(f"\n{len(wanted)} objects in {SHIPPED}")
