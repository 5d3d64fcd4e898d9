"""Compile the loops into a library that needs nothing else: for this machine, or for others.

    python engine/kernels/build.py                      # for this machine, where Lensfield looks for it, if it is older
    python engine/kernels/build.py FOLDER PLATFORM ...  # for these platforms, by cross compilers: see COMPILERS

It needs no more than Python and a C compiler (gcc or clang; CC names another), for `pip install` runs it before there
is anything else. The same compiler makes the same bytes of the same sources, wherever these lie.
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

LOOPS = ("spreading", "footprints", "turning", "waves", "cast")
VARIANTS: dict[str, dict[str, tuple[int, list[str]]]] = {
    "x64": {"base": (4, []), "avx2": (8, ["-mavx2"]), "avx512": (16, ["-mavx512f", "-mavx512vl", "-mavx512dq"])},
    "arm64": {"neon": (4, [])},
}
"""Of each machine, from the simplest to the quickest: the floats that it takes at once, and its compiler's flags."""

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
"""Those that make another machine's library. Macs' also want LLVM's linker, lld."""


class CompilerMissing(Exception):
    """There is no compiler for a platform."""


def this_platform() -> str:
    """The system and the machine that this Python runs on, as "linux-x64"."""
    system = {"linux": "linux", "darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform)
    machine = {"x86_64": "x64", "amd64": "x64", "arm64": "arm64", "aarch64": "arm64"}
    return f"{system}-{machine.get(platform.machine().lower(), platform.machine())}"


def library_name(target: str) -> str:
    """What the library of a platform is called."""
    return f"kernels-{target}{SUFFIX.get(target.split('-')[0], '.so')}"


def sources_digest() -> str:
    """Tells a library from one of other sources; "" where they are not at hand."""
    sources = sorted(HERE.glob("*.[ch]"))
    texts = "".join(path.read_text(encoding="utf-8") for path in [*sources, Path(__file__)])
    return hashlib.sha256(texts.encode()).hexdigest()[:16] if sources else ""


def up_to_date(library: Path) -> bool:
    """Whether a library is there, and made from the sources as they are."""
    return library.is_file() and sources_digest().encode() in library.read_bytes()


def build(folder: Path, target: str | None = None) -> Path:
    """The library of a platform in a folder: its path.

    Raises
    ------
    CompilerMissing
    subprocess.CalledProcessError
        The compiler failed, and has told why.
    """
    target = target or this_platform()
    system, machine = target.split("-")
    if system not in SUFFIX or machine not in VARIANTS:
        raise CompilerMissing(f"there are no C loops for {target}")
    command = compiler(target)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        made = Path(temporary) / library_name(target)
        subprocess.run([*command, *_linking(target, Path(temporary)), "-o", made.name,
                        *objects(target, Path(temporary))], check=True, cwd=temporary)
        os.replace(made, folder / made.name)  # at once: others may be loading it
    return folder / library_name(target)


def objects(target: str, folder: Path, flags: Sequence[str] = ()) -> list[str]:
    """What `build` links: the names of object files in a folder, compiled with these flags, too."""
    made, machine = [], target.split("-")[1]

    def compiled(source, *own):
        made.append(f"{len(made)}.o")  # no path gets in: sources are named from their own folder
        subprocess.run([*compiler(target), *FLAGS, *flags, *own, "-c", source, "-o", str(folder / made[-1])],
                       check=True, cwd=HERE)

    for variant, (lanes, own) in VARIANTS[machine].items():
        for loop in LOOPS:
            compiled(f"{loop}.c", f"-DVARIANT={variant}", f"-DLANES={lanes}", *own)
    compiled("kernels.c", f'-DLF_SOURCES="{sources_digest()}"')
    return made


def compiler(target: str) -> list[str]:
    """The beginning of the commands that compile for a platform.

    Raises
    ------
    CompilerMissing
    """
    own = target == this_platform()
    names = [os.environ["CC"]] if own and "CC" in os.environ else [*(("cc", "gcc", "clang") * own), COMPILERS[target]]
    found = [command for command in map(shlex.split, names) if shutil.which(command[0])]
    if not found:
        raise CompilerMissing(f"{' or '.join(names)} is not installed")
    if target.startswith("windows"):  # whose stack is aligned to less than AVX's moves want
        return [*found[0], "-Wa,-muse-unaligned-vector-move"]
    if target.startswith("macos") and not own:
        return [*found[0], f"--target={'arm64' if target.endswith('arm64') else 'x86_64'}-apple-macos11.0"]
    return found[0]


def _linking(target, folder):
    """What makes a library of the objects: without a C library, so that it fits every system's."""
    system = target.split("-")[0]
    if system == "linux":
        return ["-shared", "-nostdlib", "-Wl,--no-undefined", "-Wl,--build-id=none", "-s"]
    if system == "windows":
        return ["-shared", "-nostdlib", "-Wl,-e,0", "-Wl,--no-insert-timestamp", "-s"]
    if target == this_platform():
        return ["-dynamiclib", f"-Wl,-install_name,@rpath/{library_name(target)}"]
    # Every Mac library has to name the system's, though this one calls nothing in it.
    (folder / "libSystem.tbd").write_text(SYSTEM_STUB)
    return ["-dynamiclib", "-nostdlib", "-fuse-ld=lld", "libSystem.tbd",
            f"-Wl,-install_name,@rpath/{library_name(target)}"]


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
    """What it means that `build` failed."""
    if isinstance(problem, subprocess.CalledProcessError):
        problem = CompilerMissing(f"{problem.cmd[0]} cannot compile them")
    return f"no loops in C, numpy does their work: {problem}"


def main(arguments: list[str]) -> int:
    """What the command line asks for; 1 and a line of text where a compiler is missing or fails."""
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
