"""Starts a program that can only read and write below given folders, with limits on memory and processor time.

    python confine.py LIMITS.json PROGRAM ARGUMENTS...

The limits apply to the program and all processes that it starts, and cannot be lifted. Memory and processor time are
limited by RLIMIT_AS and RLIMIT_CPU, everything else by Landlock, which Linux has since 5.13:
https://docs.kernel.org/userspace-api/landlock.html
This file runs in a process with a single thread, because Landlock confines the calling thread.
"""

import ctypes
import json
import os
import signal
import struct
import sys

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # the same numbers on all processors
GET_VERSION = 1
PATH_BENEATH = 1
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, TRUNCATE, IOCTL_DEV = (1 << bit for bit in (0, 1, 2, 3, 14, 15))
FILE_RIGHTS = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEV  # the rights allowed in a rule about a file
READ = EXECUTE | READ_FILE | READ_DIR
FILE_BITS = 13, 14, 15, 15, 16  # number of access rights in each version of Landlock, from version 1
TCP_SINCE, TCP = 4, 0b11  # bind and connect
SCOPES_SINCE, SCOPES = 6, 0b11  # abstract sockets, and signals to processes outside
NO_NEW_PRIVILEGES, DEATH_SIGNAL = 38, 1  # prctl options


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        limits = json.load(file)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DEATH_SIGNAL, signal.SIGTERM)
        confine(limits["read"], limits["write"])
    limit_resources(limits["memory_bytes"], limits["cpu_s"])
    os.execvp(sys.argv[2], sys.argv[2:])


def limit_resources(memory_bytes, cpu_s):
    import resource

    for kind, most in ((resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_CPU, cpu_s), (resource.RLIMIT_CORE, 0)):
        _, hard = resource.getrlimit(kind)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (most, most))


def landlock_version():
    """This system's version of Landlock; 0 without it."""
    if sys.platform != "linux":
        return 0
    return max(ctypes.CDLL(None).syscall(CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(GET_VERSION)), 0)


def confine(read, write):
    """Confine this process by Landlock: it may read below the paths in `read`, and read and write below `write`."""
    version = landlock_version()
    if not version:
        return
    every = (1 << FILE_BITS[min(version, len(FILE_BITS)) - 1]) - 1
    known = (every, *[TCP] * (version >= TCP_SINCE), *[SCOPES] * (version >= SCOPES_SINCE))
    handled = struct.pack(f"{len(known)}Q", *known)
    rules = _call(CREATE_RULESET, handled, ctypes.c_size_t(len(handled)), ctypes.c_uint32(0))
    for paths, rights in ((read, READ), (write, every & ~IOCTL_DEV)):
        for path in paths:
            _allow(rules, path, rights & every)
    ctypes.CDLL(None).prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    _call(RESTRICT_SELF, ctypes.c_int(rules), ctypes.c_uint32(0))
    os.close(rules)


def _allow(rules, path, rights):
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:  # does not exist on this system
        return
    if not os.path.isdir(path):
        rights &= FILE_RIGHTS
    _call(ADD_RULE, ctypes.c_int(rules), ctypes.c_int(PATH_BENEATH), struct.pack("=Qi", rights, handle),
          ctypes.c_uint32(0))
    os.close(handle)


def _call(number, *arguments):
    libc = ctypes.CDLL(None, use_errno=True)
    result = libc.syscall(ctypes.c_long(number), *arguments)
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error))
    return result


if __name__ == "__main__":
    main()
