"""The identity of this build: a digest of all sources, computed when a wheel or an extension is built.

A checkout computes it on import. It covers every source that affects a result, the loops in C included, and is part of
every cache key and of every record, report and file header: no result of one build is taken for another's.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
SOURCES = ("__init__.py", "cli.py", "request.py", "restart.py", "engine/**/*", "addon/**/*", "commands/**/*")
SUFFIXES = (".py", ".c", ".h", ".osl", ".wgsl", ".csv", ".spd", ".yml")
"""Code and tables. Lenses of the library are not among them: keys that depend on a lens contain its own digest."""
HEX_DIGITS = 16
BUILT = "engine/runtime/build_identity.txt"
"""In a wheel and an extension: the identity, which they cannot compute as they do not contain all sources."""
MARK = "Made by Lensfield"
"""This text is near the beginning of every file that Lensfield writes."""


def sources_identity(package: Path = PACKAGE) -> str:
    """A digest of the names and contents of a package's sources in Python, C, OSL and WGSL, and of its tables.

    Parameters
    ----------
    package : Path
        The folder that contains `engine`, `addon` and `commands`.

    Returns
    -------
    str
        16 hexadecimal digits.
    """
    digest = hashlib.sha256()
    paths = {path for pattern in SOURCES for path in package.glob(pattern) if path.suffix in SUFFIXES}
    for name, path in sorted((path.relative_to(package).as_posix(), path) for path in paths):
        content = path.read_bytes()
        digest.update(f"{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:HEX_DIGITS]


def identity_of(package: Path) -> str:
    """The identity of a package: the one stored when it was built, or the digest of its sources."""
    built = package / BUILT
    return built.read_text(encoding="ascii") if built.is_file() else sources_identity(package)


def store(sources: Path, package: Path) -> None:
    """Store the identity of these sources in a package built from them."""
    target = package / BUILT
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(sources_identity(sources), encoding="ascii")


_identity = identity_of(PACKAGE)  # on import: an update may replace the files while this process runs the old code


def build_identity() -> str:
    """The identity of this build: 16 hexadecimal digits.

    It is the same on all platforms: they produce the same bits from the same sources, so that machines of different
    systems can share a folder of frames. Light that a GPU casts differs by rounding, and reports name the GPU. A
    library of compiled loops made from other C sources is not used.
    """
    return _identity


def software() -> str:
    """The program and build, as files name the program that wrote them."""
    return f"{MARK} (build {build_identity()})"


def is_accepted(build: str | None, any_build: bool) -> bool:
    """Whether a finished frame counts: one of this build, or of any build if the user accepts that."""
    return build is not None and (any_build or build == build_identity())


def other_builds_line(builds: Iterable[str | None], any_build: bool, verb: str) -> list[str]:
    """A line about the frames that other builds finished, if any.

    Parameters
    ----------
    builds : iterable of str or None
        For each frame the build that finished it; None for an unfinished one.
    any_build : bool
        Whether these frames are accepted.
    verb : str
        "rendered" or "filtered".
    """
    builds = list(builds)
    others = sum(build not in (None, build_identity()) for build in builds)
    if not others:
        return []
    remedy = "accepted by --any-build" if any_build else f"{verb} again; --any-build accepts them"
    return [f"{others} of {len(builds)} frames come from another build of Lensfield: {remedy}"]
