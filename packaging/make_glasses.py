"""Write engine/prescription/glasses.csv, the catalogues of glasses, from Optiland's copy of refractiveindex.info.

    .venv-bake/bin/python packaging/make_glasses.py

Each line is a glass: its maker and name, the database's dispersion formula with its coefficients (or "n", for a table
of nm and index), the range in nm, and extinction coefficients at visible wavelengths in nm. The database is in the
public domain (CC0 1.0): M. N. Polyanskiy, doi:10.1038/s41597-023-02898-2.
"""

from importlib import resources
from pathlib import Path

import yaml

from lensfield.engine.prescription.glasses import CATALOGUE

DATABASE = Path(str(resources.files("optiland.database"))) / "data-nk" / "glass"
LEFT_OUT = ("ami", "misc")  # infrared materials, and windows
VISIBLE_NM = (350, 830)
DIGITS = 3  # of extinction: glasses absorb so little that more digits are irrelevant


def line_of(path):
    """The line of one file, or None for a material without an index."""
    data = {entry["type"]: entry for entry in yaml.safe_load(path.read_text(encoding="utf-8"))["DATA"]}
    kind = next((kind for kind in data if kind.startswith("formula")), "tabulated n")
    if kind not in data:
        return None
    if kind == "tabulated n":
        rows = pairs(data[kind]["data"])
        number, dispersion = "n", " ".join(f"{nm:g} {index:.9g}" for nm, index in rows)
        first, last = rows[0][0], rows[-1][0]
    else:
        number, dispersion = kind.split()[1], " ".join(data[kind]["coefficients"].split())
        first, last = (round(1e3 * float(word), 6) for word in data[kind]["wavelength_range"].split())
    extinction = visible(pairs(data.get("tabulated k", {}).get("data", "")))
    absorbed = " ".join(f"{nm:g} {k:.{DIGITS}g}" for nm, k in extinction)
    maker = path.relative_to(DATABASE).parts[0].upper()
    return f"{maker} {path.stem},{number},{dispersion},{first:g} {last:g},{absorbed}"


def visible(rows):
    """The rows at visible wavelengths, and one more at either end."""
    inside = [place for place, (nm, _) in enumerate(rows) if VISIBLE_NM[0] <= nm <= VISIBLE_NM[1]]
    first = inside[0] if inside else next((place for place, (nm, _) in enumerate(rows) if nm > VISIBLE_NM[1]), 0)
    last = inside[-1] if inside else first - 1
    return rows[max(first - 1, 0):last + 2]


def pairs(text):
    """(nm, value) from a table in micrometres, ascending."""
    rows = [tuple(map(float, line.split())) for line in text.splitlines() if line.strip()]
    return sorted({round(1e3 * um, 6): value for um, value in rows}.items())


def main():
    files = [path for path in sorted(DATABASE.rglob("*.yml")) if path.relative_to(DATABASE).parts[0] not in LEFT_OUT]
    lines = list(filter(None, map(line_of, files)))
    CATALOGUE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{CATALOGUE.name}: {len(lines)} glasses, {CATALOGUE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
