"""The lock file satisfies all of the project's requirements. If it does not, run `make lock`."""

import re
import tomllib

from packaging.requirements import Requirement  # installed with pytest

from places import ROOT

LINE = re.compile(r"([\w.-]+)==(\S+) --hash=sha256:[0-9a-f]{64}")
EXTRAS = "gpu", "test"  # as in packaging/environment.sh


def test_lock_fits_the_project():
    lines = [line for line in (ROOT / "packaging/lock-5.0.1.txt").read_text().splitlines() if not line.startswith("#")]
    locked = {name.lower(): version for name, version in (LINE.fullmatch(line).groups() for line in lines)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    for text in ("bpy==5.0.1", *project["dependencies"], *(line for extra in EXTRAS for line in extras[extra])):
        wanted = Requirement(text)
        assert wanted.specifier.contains(locked[wanted.name.lower()]), text
