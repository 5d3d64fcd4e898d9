"""Damage files of every kind, and check that readers read or reject them: fuzz.py [--count N] [--seed N] [--only NAME]

Each mutant is read in a separate process, which may use 600 MB in addition to its initial memory, and 700 units of work
in addition to the valid file's. A unit is the parsing of a text, whose processor time is measured before each file: if
it is 3 ms, the limit is 2 s. A hang counts only if it happens twice. The result must be the contents, or an InputError
of one short line in which every character is printable. Anything else is a finding: another error, a warning, output on
a standard stream, a signal, too much time or memory. Each finding is listed with its seed and its number, with which
--number reproduces it. The exit status is 1 if there are any. Requires fork.
"""

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported: forked processes have one thread
import argparse
import contextlib
import resource
import signal
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
import zlib
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / folder) for folder in ("fuzz", "support", "stand_ins", "engine/bake")]

import numpy as np  # noqa: E402
from formats import formats  # noqa: E402

from lensfield.engine import InputError  # noqa: E402
from lensfield.engine.lens_files import iset_mat, iset_mat_child  # noqa: E402
from waiting import LAST_RESORT_S  # noqa: E402

MEMORY_BYTES, MORE_UNITS, BASELINE_UNITS = 600 * 2**20, 700, 20_000
UNIT_OF_WORK = "[[surfaces]]\nthickness_mm = 1.5\n" * 300  # in pure Python, like most of the readers
HANG = "hang: "
LONGEST_MESSAGE = 900
READ, REJECTED = "read", "rejected"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=1500, help="mutants of each format (default %(default)s)")
    parser.add_argument("--seed", type=int, default=int(os.environ.get("SEED", 0)))
    parser.add_argument("--only", help="formats with this in their names")
    parser.add_argument("--number", type=int, help="this mutant alone, whose outcome is printed in full")
    options = parser.parse_args()
    iset_mat._run_child = forked_child  # starting a new interpreter for each file would take twenty times as long
    print(f"seed {options.seed}, {options.count} mutants of each format", flush=True)
    findings = 0
    with tempfile.TemporaryDirectory(prefix="lensfield-fuzz-") as folder:
        for name, kind in formats(Path(folder)):
            if not options.only or options.only in name:
                findings += fuzzed(name, kind, options, Path(folder))
    sys.exit(findings > 0)


def fuzzed(name, kind, options, folder):
    """Read the mutants of a format, and print a summary and each finding; returns the number of findings."""
    outcomes, longest_s, most_bytes, findings = Counter(), 0.0, 0, []
    begun = time.monotonic()
    folder = Path(tempfile.mkdtemp(dir=folder))
    sounds = [(sound, took_s) for sound in kind.sounds if (took_s := baseline_s(kind, sound, folder))]
    for number in range(options.count) if options.number is None else [options.number]:
        random = np.random.default_rng([options.seed, zlib.crc32(name.encode()), number])
        sound, sound_s = sounds[number % len(sounds)]
        outcome, taken_s, taken_bytes = read_within(MORE_UNITS, kind, mutant(kind, sound, random), folder, sound_s)
        what = outcome.partition(": ")[0]
        outcomes[what] += 1
        longest_s, most_bytes = max(longest_s, taken_s), max(most_bytes, taken_bytes)
        if what not in (READ, REJECTED):
            findings.append(f"  number {number}: {outcome}")
        elif options.number is not None:
            print(outcome)
    count = sum(outcomes.values()) - outcomes[READ] - outcomes[REJECTED]
    print(f"{name:<26} {outcomes[READ]:5} read {outcomes[REJECTED]:5} rejected {count:3} findings   "
          f"at most {longest_s:5.2f} s and {most_bytes / 2**20:3.0f} MB   ({time.monotonic() - begun:.0f} s)",
          *findings, sep="\n", flush=True)
    return count


def mutant(kind, sound, random):
    """The files of a valid sample, one of them damaged: half of the time the one passed to the reader."""
    names = sorted(sound.files)
    name = sound.entry if random.random() < 0.5 else names[random.integers(len(names))]
    return sound.entry, sound.files | {name: kind.damage(sound.files[name], random)}


def baseline_s(kind, sound, folder):
    """Processor seconds for a valid file; None for a rejected one. The first sample, which is ours, must be read."""
    outcome, taken_s, _ = read_within(BASELINE_UNITS, kind, (sound.entry, sound.files), folder)
    if outcome != READ and sound is kind.sounds[0]:
        raise SystemExit(f"the sound {sound.entry} is not read: {outcome}")
    return taken_s if outcome == READ else None


def unit_s():
    """Processor seconds of a unit of work on this machine, under its current load."""
    def once():
        begin_s = time.process_time()
        tomllib.loads(UNIT_OF_WORK)
        return time.process_time() - begin_s

    return min(once() for _ in range(3))


def read_within(units, kind, files, folder, more_s=0.0):
    """The result of `read_apart` under a limit in units of work; a hang is retried, with the unit measured again."""
    for _ in range(2):
        outcome, taken_s, taken_bytes = read_apart(kind, files, folder, more_s + units * unit_s())
        if not outcome.startswith(HANG):
            break
    return outcome, taken_s, taken_bytes


def read_apart(kind, files, folder, limit_s):
    """The result of reading files in a separate process: (outcome, processor seconds, bytes)."""
    entry, contents = files
    for name, data in contents.items():
        (folder / name).write_bytes(data)
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(receive)
        work_in_child(kind, folder / entry, limit_s, send)
    os.close(send)
    with open(receive, "rb") as stream:
        report = stream.read().decode("utf-8", "replace")
    _, status, usage = os.wait4(child, 0)
    taken_s = usage.ru_utime + usage.ru_stime
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        hung = number in (signal.SIGPROF, signal.SIGALRM, signal.SIGXCPU)
        return f"{HANG}over {limit_s:.1f} s" if hung else f"signal: {signal.Signals(number).name}", taken_s, 0
    taken, _, outcome = report.partition(" ")
    if taken_s > limit_s:  # including the reader's child processes
        outcome = f"{HANG}{taken_s:.1f} s"
    return outcome, taken_s, int(taken)


def work_in_child(kind, path, limit_s, send):
    """Read a file under limits, report the outcome, and exit."""
    begun = resident_bytes("VmRSS")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    address_space = resident_bytes("VmSize") + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (address_space, address_space))
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    signal.alarm(round(LAST_RESORT_S))  # for a reader that waits without using the processor
    with tempfile.TemporaryFile() as said:
        for stream in (1, 2):
            os.dup2(said.fileno(), stream)
        outcome = outcome_of(kind, path)
        sys.stdout.flush()
        sys.stderr.flush()
        if said.seek(0, os.SEEK_END) and not kind.chatters:
            said.seek(0)
            outcome = f"chatter: {said.read(200)!r}"
    os.write(send, f"{resident_bytes('VmHWM') - begun} {outcome[:3000]}".encode("utf-8", "replace"))
    os._exit(0)


def outcome_of(kind, path):
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            kind.read(path)
        return READ
    except InputError as error:
        text = str(error)
        sound = text.isprintable() and len(text) <= LONGEST_MESSAGE
        return f"{REJECTED}: {text}" if sound else f"message: {len(text)} characters: {text[:300]!r}"
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-5:]
        steps = " < ".join(f"{Path(step.filename).name}:{step.lineno}" for step in reversed(where))
        return f"{type(error).__name__}: {str(error)[:200]!r} at {steps}"


def resident_bytes(name):
    """A memory figure of this process in bytes, which Linux reports in kB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return 1024 * int(line.split()[1])


def forked_child(path, target, memory_bytes):
    """A replacement for `iset_mat._run_child` in a forked process."""
    receive, send = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(send, 2)
        status = 1
        with contextlib.suppress(BaseException):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    iset_mat_child.main(str(path), str(target), str(memory_bytes))
                status = 0
            except BaseException as error:
                print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
        os._exit(status)
    os.close(send)
    with open(receive, "rb") as stream:
        said = stream.read()
    _, status = os.waitpid(child, 0)
    if status:
        raise iset_mat._refusal(path, said)


if __name__ == "__main__":
    main()
