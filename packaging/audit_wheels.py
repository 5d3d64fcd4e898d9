"""Check what the compiled loops in wheels need of a system: nothing but that it can load them.

    python packaging/audit_wheels.py WHEEL ...

prints a line for each wheel. The exit status is 1 if a wheel does not contain the one library that its name promises,
or if the library is for another machine, needs other libraries than macOS's own, imports functions, does not have all
functions of kernels.h, or requires a newer macOS than the wheel's name states.
"""

import sys
import zipfile
from pathlib import Path

import lief

from lensfield.engine.kernels.build import LIBRARY_FOLDER, WHEEL_TAGS, library_name
from lensfield.engine.kernels.declarations import FUNCTIONS

MACHINES = {"x64": {"X86_64", "AMD64"}, "arm64": {"AARCH64", "ARM64"}}
PART_OF_MACOS = {"/usr/lib/libSystem.B.dylib"}
BINDER = "dyld_stub_binder"  # macOS's loader, which every library of it names
OLDEST_MACOS = [11, 0, 0]


def findings(wheel):
    """The faults of the library in a wheel: list of texts."""
    tag = wheel.stem.split("-", 4)[-1]
    target = next((name for name, each in WHEEL_TAGS.items() if each == tag), None)
    if not target:
        return [f"no platform has the tag {tag}"]
    with zipfile.ZipFile(wheel) as contents:
        names = [name for name in contents.namelist() if f"/{LIBRARY_FOLDER.name}/" in name]
        if [Path(name).name for name in names] != [library_name(target)]:
            return [f"expected one library, {library_name(target)}, found {', '.join(names) or 'none'}"]
        library = lief.parse(contents.read(names[0]))
    return list(findings_in(library, target))


def findings_in(library, target):
    """Yield the faults of a library for a platform."""
    is_mac = isinstance(library, lief.MachO.Binary)
    header = library.header
    machine = (header.cpu_type if is_mac else getattr(header, "machine_type", None) or header.machine).name
    if machine not in MACHINES[target.split("-")[1]]:
        yield f"it is for {machine}"
    needed = {getattr(each, "name", each) for each in library.libraries}
    if is_mac:
        needed -= {f"@rpath/{library_name(target)}", *PART_OF_MACOS}
        if library.build_version.minos > OLDEST_MACOS:
            yield f"it requires macOS {'.'.join(map(str, library.build_version.minos))}"
    if needed:
        yield f"it needs {', '.join(sorted(needed))}"
    if imported := imports(library) - {BINDER, ""}:
        yield f"it imports {', '.join(sorted(imported))}"
    if absent := set(FUNCTIONS) - {each.name.removeprefix("_") for each in library.exported_functions}:
        yield f"it lacks {', '.join(sorted(absent))}"


def imports(library):
    """The names of what a library takes from others."""
    if isinstance(library, lief.ELF.Binary):
        return {each.name for each in library.dynamic_symbols if each.shndx == 0}
    return {each.name for each in library.imported_functions}


def main(paths):
    found = {path: findings(Path(path)) for path in paths}
    for path, texts in found.items():
        print(f"{Path(path).name}: {'; '.join(texts) or 'needs nothing'}")
    sys.exit(any(found.values()))


if __name__ == "__main__":
    main(sys.argv[1:])
