"""Write the lock file of an environment from pip's report: exact versions, with the files' hashes.

    python packaging/write_lock.py REPORT.json LOCK.txt

`make lock` runs it, in a new environment that was created without a lock.
"""

import json
import sys
from pathlib import Path

HEAD = """\
# What `make demo` and `make test` install for bpy 5.0.1: Python 3.11, Linux on x86-64. Made by `make lock`.
"""


def pinned(report):
    """Lines of a requirements file, by name, for each package of pip's report that was installed from a file."""
    for package in sorted(report["install"], key=lambda package: package["metadata"]["name"].lower()):
        if "archive_info" in package["download_info"]:  # otherwise it is this tree
            name, version = (package["metadata"][field] for field in ("name", "version"))
            yield f"{name}=={version} --hash=sha256:{package['download_info']['archive_info']['hashes']['sha256']}\n"


def main(report, lock):
    Path(lock).write_text(HEAD + "".join(pinned(json.loads(Path(report).read_text(encoding="utf-8")))))


if __name__ == "__main__":
    main(*sys.argv[1:])
