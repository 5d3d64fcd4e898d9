"""Lines of words and numbers, as other programs' prescriptions are made of, that tell where they stand."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from ...errors import LensError


class Line(NamedTuple):
    """The words of a line, and where it stands: file, and what to call its place there."""

    path: Path
    place: str
    words: tuple[str, ...]

    def figure(self, index: int, default: float | None = None) -> float:
        """The number at this place among the words; the default, if there is one, where the line is shorter.

        Raises
        ------
        LensError
            Another word, or none.
        """
        if index >= len(self.words) and default is not None:
            return default
        try:
            return float(self.words[index])
        except (ValueError, IndexError):
            raise self.refusal(f"expected a number as word {index + 1}") from None

    def figures(self, first: int = 1) -> list[float]:
        """All numbers from this word on."""
        return [self.figure(index) for index in range(first, len(self.words))]

    def refusal(self, remedy: str) -> LensError:
        """The error that shows the line."""
        return LensError(self.path, self.place, " ".join(filter(None, self.words)), remedy)


def numbered(path: Path, lines: Iterable[str], separator: str | None = None) -> Iterator[Line]:
    """The lines that are not blank, by their numbers from 1."""
    for number, line in enumerate(lines, 1):
        words = tuple(line.split(separator))
        if any(map(str.strip, words)):
            yield Line(path, f"line {number}", words)
