"""Compile the loops into a library without dependencies, for this machine or for others.

    python engine/kernels/build.py                      # for this machine, in its place, unless it is up to date
    python engine/kernels/build.py FOLDER PLATFORM ...  # for these platforms, by cross compilers: see COMPILERS

It requires only Python and a C compiler (gcc or clang; CC names another), because `pip install` runs it before any
dependency is installed. The same compiler produces the same bytes from the same sources in any folder.
"""

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
LIBRARY_FOLDER = HERE / "lib"

LOOPS = ("spreading", "extremes", "excess", "footprints", "turning", "waves", "tracing", "fitting", "spots", "cast",
         "collecting", "reading", "ghosts", "control")
VARIANTS: dict[str, dict[str, tuple[int, list[str]]]] = {
    "x64": {"base": (4, []), "avx2": (8, ["-mavx2"]), "avx512": (16, ["-mavx512f", "-mavx512vl", "-mavx512dq"])},
    "arm64": {"neon": (4, [])},
}
"""For each machine, from the simplest to the fastest: the number of floats in a vector, and the compiler's flags."""

FLAGS = ["-std=gnu11", "-O3", "-fPIC", "-ffreestanding", "-fvisibility=hidden", "-fno-stack-protector",
         "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-Wall", "-Wextra", "-Wno-psabi"]
SUFFIX = {"linux": ".so", "windows": ".dll", "macos": ".dylib"}
COMPILERS = {
    "linux-x64": "x86_64-linux-gnu-gcc",
    "linux-arm64": "aarch64-linux-gnu-gcc",
    "windows-x64": "x86_64-w64-mingw32-gcc",
    "macos-arm64": "clang",
    "macos-x64": "clang",
}
"""Cross compilers for other machines' libraries. Those for Macs also require LLVM's linker, lld."""
WHEEL_TAGS = {
    "linux-x64": "manylinux_2_17_x86_64.manylinux2014_x86_64",
    "linux-arm64": "manylinux_2_17_aarch64.manylinux2014_aarch64",
    "windows-x64": "win_amd64",
    "macos-arm64": "macosx_11_0_arm64",
    "macos-x64": "macosx_11_0_x86_64",
}
"""How the names of wheels state these platforms. The libraries need nothing of a system but that it can load them."""


class CompilerMissing(Exception):
    """A platform's compiler is missing."""


def this_platform() -> str:
    """The system and the machine that this Python runs on, as "linux-x64"."""
    system = {"linux": "linux", "darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    machine = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}
    return f"{system}-{machine.get(platform.machine().lower(), platform.machine())}"


def library_name(target: str) -> str:
    """The file name of a platform's library."""
    return f"kernels-{target}{SUFFIX.get(target.split('-')[0], '.so')}"


def sources_digest() -> str:
    """Distinguishes a library from one of other sources; "" if the sources are missing."""
    if not (HERE / "kernels.c").exists():  # a wheel contains kernels.h alone
        return ""
    texts = "".join(path.read_text(encoding="utf-8") for path in [*sorted(HERE.glob("*.[ch]")), Path(__file__)])
    return hashlib.sha256(texts.encode()).hexdigest()[:16]


def up_to_date(library: Path) -> bool:
    """Whether a library exists and was built from the current sources."""
    return library.is_file() and sources_digest().encode() in library.read_bytes()


def build(folder: Path, target: str | None = None) -> Path:
    """Build the library of a platform in a folder, and return its path.

    Raises
    ------
    CompilerMissing
    subprocess.CalledProcessError
        The compiler failed, and has printed the reason.
    """
    target = target or this_platform()
    system, machine = target.split("-")
    if system not in SUFFIX or machine not in VARIANTS:
        raise CompilerMissing(f"C loops are not available for {target}")
    command = compiler(target)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        library = Path(temporary) / library_name(target)
        subprocess.run([*command, *_linking(target, Path(temporary)), "-o", library.name,
                        *objects(target, Path(temporary)), *LIBRARIES.get(system, [])], check=True, cwd=temporary)
        os.replace(library, folder / library.name)  # atomic: other processes may be loading it
    return folder / library_name(target)


def objects(target: str, folder: Path, flags: Sequence[str] = ()) -> list[str]:
    """Compile the object files that `build` links, with these additional flags, and return their names."""
    names, machine = [], target.split("-")[1]

    def compile_source(source, *source_flags):
        names.append(f"{len(names)}.o")  # relative paths, because absolute ones would be stored in the objects
        subprocess.run([*compiler(target), *FLAGS, *flags, *source_flags, "-c", source, "-o", str(folder / names[-1])],
                       check=True, cwd=HERE)

    for variant, (lanes, variant_flags) in VARIANTS[machine].items():
        for loop in LOOPS:
            compile_source(f"{loop}.c", f"-DVARIANT={variant}", f"-DLANES={lanes}", *variant_flags)
    compile_source("kernels.c", f'-DLF_SOURCES="{sources_digest()}"')
    return names


def compiler(target: str) -> list[str]:
    """The first words of the commands that compile for a platform.

    Raises
    ------
    CompilerMissing
    """
    native = target == this_platform()
    names = [os.environ["CC"]] if native and "CC" in os.environ else [
        *(("cc", "gcc", "clang") * native), COMPILERS[target]]
    installed = [command for command in map(shlex.split, names) if shutil.which(command[0])]
    if not installed:
        raise CompilerMissing(f"{' or '.join(names)} is not installed")
    if target.startswith("windows"):  # its stack alignment is too small for aligned AVX moves
        return [*installed[0], "-Wa,-muse-unaligned-vector-move"]
    if target.startswith("macos") and not native:
        return [*installed[0], f"--target={'arm64' if target.endswith('arm64') else 'x86_64'}-apple-macos11.0"]
    return installed[0]


def _linking(target, folder):
    """Flags for linking the objects to a library, without a C library, to be independent of the system."""
    system = target.split("-")[0]
    if system == "linux":
        return ["-shared", "-nostdlib", "-Wl,--no-undefined", "-Wl,--build-id=none", "-s"]
    if system == "windows":
        return ["-shared", "-nostdlib", "-Wl,-e,0", "-Wl,--no-insert-timestamp", "-s"]
    if target == this_platform():
        return ["-dynamiclib", f"-Wl,-install_name,@rpath/{library_name(target)}"]
    # Every Mac library must name the system library, although this one does not call it.
    (folder / "libSystem.tbd").write_text(SYSTEM_STUB)
    return ["-dynamiclib", "-nostdlib", "-fuse-ld=lld", "libSystem.tbd",
            f"-Wl,-install_name,@rpath/{library_name(target)}"]


LIBRARIES = {"windows": ["-lgcc"]}  # static: what reserves the memory of a function's large arrays there
SYSTEM_STUB = """--- !tapi-tbd
tbd-version:     4
targets:         [ x86_64-macos, arm64-macos ]
install-name:    '/usr/lib/libSystem.B.dylib'
current-version: 1
exports:
  - targets:     [ x86_64-macos, arm64-macos ]
    symbols:     [ dyld_stub_binder ]
...
"""


def without(problem: Exception) -> str:
    """A message about the consequence of a failure of `build`."""
    if isinstance(problem, subprocess.CalledProcessError):
        problem = CompilerMissing(f"{problem.cmd[0]} cannot compile the C loops")
    return f"the C loops are unavailable, so numpy is used: {problem}"


def main(arguments: list[str]) -> int:
    """Run the command line; print a line of text and return 1 if a compiler is missing or fails."""
    folder = Path(arguments[0]).resolve() if arguments else LIBRARY_FOLDER
    if not arguments and up_to_date(folder / library_name(this_platform())):
        return 0
    try:
        for target in arguments[1:] or [this_platform()]:
            print(build(folder, target))
    except (CompilerMissing, subprocess.CalledProcessError) as problem:
        print(f"lensfield: {without(problem)}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
