"""Build an FMU, version 2 or 3, of the hydraulic actuator with the system's C compiler."""

import inspect
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
from fmpy import fmi2, fmi3

SOURCE = Path(__file__).parent / "fmu" / "hydraulic.c"
COMPILER = shutil.which("cc") or shutil.which("gcc")
NAMES = ("u", "hm0", "hmd", "delta_0", "P_s", "breaks_s", "breaks_as", "delta", "rod", "x3")
PARAMETERS, RESULTS = ("delta_0", "P_s", "breaks_s", "breaks_as"), ("delta", "rod", "x3")
MAP = {
    "servo": "hydraulic",
    "inputs.valve_command": {"variable": "u"},
    "inputs.hinge_0": {"variable": "hm0", "unit": "N m"},
    "inputs.hinge_slope": {"variable": "hmd", "unit": "N m/rad"},
    "start.surface": {"variable": "delta_0", "unit": "rad"},
    "outputs.surface": {"variable": "delta", "unit": "rad"},
    "outputs.rod": {"variable": "rod", "unit": "m"},
    "outputs.pressure": {"variable": "x3"},
}


def build(folder: Path, version: int) -> Path:
    """Return the path of the FMU; `folder` takes it and what is needed on the way."""
    platform = {2: fmpy.platform, 3: fmpy.platform_tuple}[version]
    ending = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
    library = folder / f"rig{version}{ending}"
    stubs = folder / "stubs.c"
    stubs.write_text(_stubs())
    subprocess.run([COMPILER, "-O2", "-shared", "-fPIC", "-o", library, SOURCE, stubs, "-lm"], check=True)
    path = folder / f"rig{version}.fmu"
    with zipfile.ZipFile(path, "w") as out:
        out.writestr("modelDescription.xml", _two() if version == 2 else _three())
        out.write(library, f"binaries/{platform}/rig{ending}")
    return path


def described(path: Path, old: str, new: str) -> Path:
    """Return a copy of an FMU whose model description has `new` in place of `old`."""
    out = path.with_name(f"described_{path.name}")
    with zipfile.ZipFile(path) as held, zipfile.ZipFile(out, "w") as made:
        for name in held.namelist():
            data = held.read(name)
            assert name != "modelDescription.xml" or old.encode() in data
            made.writestr(name, data.replace(old.encode(), new.encode()) if name.endswith(".xml") else data)
    return out


def _stubs():
    """Return C of the functions that every FMU must have and this one needs not: they fail."""
    made = set(re.findall(r"(fmi[23][A-Z]\w+)\(", SOURCE.read_text()))
    verbs = "Get|Set|Cancel|Enter|Exit|Evaluate|Activate|Completed|DeSer|Deser|Serialize|Free|Instantiate|New|Update"
    names = re.findall(rf"fmi[23](?:{verbs})[A-Za-z0-9]*", inspect.getsource(fmi2) + inspect.getsource(fmi3))
    return "".join(f"int {name}(void) {{ return 3; }}\n" for name in sorted({*names} - made) if "TYPE" not in name)


def _kind(name):
    if name in PARAMETERS:
        return 'causality="parameter" variability="fixed"', ' start="0"' if name == "delta_0" else ""
    return ('causality="output"', "") if name in RESULTS else ('causality="input"', ' start="0"')


_START = {"P_s": ' start="1.4e7"', "breaks_s": ' start="1e9"', "breaks_as": ' start="3"', "rod": ' unit="m"'}
_UNITS = '<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit></UnitDefinitions>'


def _two():
    rows = ""
    for i, name in enumerate(NAMES):
        about, start = _kind(name)
        real = f"<Real{_START.get(name, start)}/>"
        rows += f'<ScalarVariable name="{name}" valueReference="{i}" {about}>{real}</ScalarVariable>\n'
    places = "".join(f'<Unknown index="{NAMES.index(n) + 1}"/>' for n in RESULTS)
    return f"""<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="rig" guid="rig">
<CoSimulation modelIdentifier="rig" canHandleVariableCommunicationStepSize="true"/>
{_UNITS}
<ModelVariables>
{rows}</ModelVariables>
<ModelStructure><Outputs>{places}</Outputs><InitialUnknowns>{places}</InitialUnknowns></ModelStructure>
</fmiModelDescription>"""


def _three():
    rows = places = ""
    for i, name in enumerate(NAMES):
        about, start = _kind(name)
        rows += f'<Float64 name="{name}" valueReference="{i}" {about}{_START.get(name, start)}/>\n'
    for kind in ("Output", "InitialUnknown"):
        places += "".join(f'<{kind} valueReference="{NAMES.index(n)}"/>' for n in RESULTS)
    return f"""<?xml version="1.0"?>
<fmiModelDescription fmiVersion="3.0" modelName="rig" instantiationToken="rig">
<CoSimulation modelIdentifier="rig" canHandleVariableCommunicationStepSize="true"/>
{_UNITS}
<ModelVariables>
<Float64 name="time" valueReference="99" causality="independent" variability="continuous"/>
{rows}</ModelVariables>
<ModelStructure>{places}</ModelStructure>
</fmiModelDescription>"""
