"""The sources of stray light beyond the edges of a radiance file's picture: its attribute `lensfield:sources`.

It is JSON text: an object with `wavelengths_nm`, and `sources`, a list of objects with a source's `name`, `direction`,
`distance_mm` (null for infinity), `radius_rad` and `irradiance`, as in `Sources`. Numbers have all their digits.
"""

import json
import math

import numpy as np

from ..image.sources import Sources
from ..runtime.errors import ImageError

ATTRIBUTE = "lensfield:sources"


def sources_attribute(sources: Sources | None) -> dict[str, str]:
    """The header's attribute for some sources; none without them."""
    if sources is None:
        return {}
    fields = (sources.directions.tolist(), sources.distance_mm.tolist(), sources.radius_rad.tolist(),
              sources.irradiance.tolist())
    listed = [{"name": name, "direction": direction, "distance_mm": None if math.isinf(distance_mm) else distance_mm,
               "radius_rad": radius_rad, "irradiance": irradiance}
              for name, direction, distance_mm, radius_rad, irradiance in zip(sources.names, *fields, strict=True)]
    return {ATTRIBUTE: json.dumps({"wavelengths_nm": sources.wavelengths_nm.tolist(), "sources": listed})}


def sources_of(header: dict, path: object) -> Sources | None:
    """The sources that a header states, bit for bit; None without the attribute, and an ImageError if it is damaged."""
    text = header.get(ATTRIBUTE)
    if text is None:
        return None
    try:
        stored = json.loads(text)
        nm, listed = np.array(stored["wavelengths_nm"], float), stored["sources"]

        def values(field, *shape):
            return np.array([each[field] for each in listed], float).reshape(len(listed), *shape)

        distance_mm = np.array([np.inf if each["distance_mm"] is None else each["distance_mm"] for each in listed],
                               float)
        return Sources(values("direction", 3), distance_mm, values("irradiance", nm.size), nm, values("radius_rad"),
                       tuple(str(each["name"]) for each in listed))
    except ImageError as error:
        raise error.at(path) from None
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise ImageError(path, ATTRIBUTE, "damaged", f"expected Lensfield's JSON text ({error})") from None
