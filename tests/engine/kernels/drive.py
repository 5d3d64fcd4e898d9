"""Drive the loops with random shapes, on every available machine: drive.py [ROUNDS [SEED]]

Each line is a report of driver.c: on this machine, under the sanitizers; and with the libraries in the extension, on
other processors through QEMU and on Windows through Wine, where these and the cross compilers are installed. The
results must be the same everywhere, to the last bit.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from lensfield.engine.kernels import build

DRIVER = Path(__file__).resolve().parent / "driver.c"
FLAGS = ["-O2", "-Wall", "-Wextra", "-ffp-contract=off", f"-I{build.HERE}", DRIVER, "-lm"]
SANITIZERS = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
WINE = shutil.which("wine64") or "/usr/lib/wine/wine64"  # Debian's is not in PATH
MACHINES = {
    "a processor without AVX": ("linux-x64", ["qemu-x86_64", "-cpu", "Nehalem"]),
    "a processor with AVX2": ("linux-x64", ["qemu-x86_64", "-cpu", "Haswell"]),
    "a machine that hides XSAVE": ("linux-x64", ["qemu-x86_64", "-cpu", "Haswell,-xsave"]),
    "Linux on ARM": ("linux-arm64", ["qemu-aarch64", "-L", "/usr/aarch64-linux-gnu"]),
    "Windows": ("windows-x64", [WINE]),
}


def sanitized(folder):
    """The command of a driver that includes the loops, compiled with the sanitizers."""
    here = build.this_platform()
    command = build.compiler(here)
    subprocess.run([*command, *SANITIZERS, *build.objects(here, folder, SANITIZERS), *FLAGS, "-o", "driver"],
                   check=True, cwd=folder)
    return ["./driver"]


def linked(folder, target, runner=()):
    """The command of a driver that uses a platform's library."""
    if runner and not shutil.which(runner[0]):
        raise build.CompilerMissing(f"{runner[0]} is not installed")
    library = build.build(folder, target).name
    program = "driver.exe" if target.startswith("windows") else "./driver"
    subprocess.run([*build.compiler(target), *FLAGS, f"./{library}", "-lm", "-o", program], check=True, cwd=folder)
    return [*runner, program]


def main(rounds="100", seed="1"):
    makers = {"this machine": lambda folder: linked(folder, build.this_platform()),
              "the sanitizers": sanitized} | {
                  name: lambda folder, machine=machine: linked(folder, *machine) for name, machine in MACHINES.items()}
    bits, failed = set(), False
    for name, make in makers.items():
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:  # Wine's server may still write to it
            try:
                command = make(Path(folder))
            except build.CompilerMissing as missing:
                print(f"{name}: skipped, {missing}", flush=True)
                continue
            completed = subprocess.run([*command, rounds, seed], cwd=folder, capture_output=True, text=True,
                                       env=os.environ | {"WINEPREFIX": f"{folder}/wine", "WINEDEBUG": "-all"})
        print(*(f"{name}: {line}" for line in completed.stdout.splitlines()), sep="\n", flush=True)
        bits |= {line.split(" bits ")[1].strip() for line in completed.stdout.splitlines() if " bits " in line}
        failed |= completed.returncode != 0
        if completed.returncode:
            print(completed.stderr, f"{name}: failed with status {completed.returncode}", sep="")
    if len(bits) > 1:
        print("not all of them give the same bits")
    return failed or len(bits) != 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
