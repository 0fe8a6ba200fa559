"""Compile every kernel that ships into actuators/objects of this checkout, for the wheel."""

import shutil

from actuators.kernels import SHIPPED, compile_ahead, target
from cosim.flight.loop.compiling import every

if not target().startswith("linux-"):
    raise SystemExit(f"objects ship for Linux on x86-64; this is {target()}")
wanted = every()
compile_ahead(wanted, lambda done, total: print(f"\rcompiled {done} of {total}", end="", flush=True))
shutil.rmtree(SHIPPED, ignore_errors=True)
(SHIPPED / target()).mkdir(parents=True)
for native in wanted:
    file = native.files[-1]
    if not file.is_file():
        raise SystemExit(f"{native.place} is not compiled")
    (SHIPPED / target() / file.name).write_bytes(file.read_bytes())
print(f"\n{len(wanted)} objects in {SHIPPED}")
