"""Scales that turn numbers into colours, and what a key says of them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WITHIN = 99  # per cent of what a frame has, zeros aside, that the colours of its scale tell apart


@dataclass(frozen=True)
class Scale:
    """Colours from one end of a range to the other: from -limit to limit where numbers have a sign, else from 0."""

    label: str
    stops: tuple[tuple[int, int, int], ...]
    ends: tuple[str, str]  # names of the first and the last colour
    signed: bool
    least: float  # limit of frames that have nothing larger than round-off
    written: Callable[[float], str]  # a number with its unit


def percent(value: float) -> str:
    """Return a share in words."""
    return f"{100 * value:g}%"


def per_metre(value: float) -> str:
    """Return a curvature in words."""
    return f"{value:g}/m"


def newtons(value: float) -> str:
    """Return a force in words."""
    return _in_units(value, ((1.0, "N"), (1e-3, "mN"), (1e-6, "µN"), (1e-9, "nN")))


def pascals(value: float) -> str:
    """Return a stress in words."""
    return _in_units(value, ((1e6, "MPa"), (1e3, "kPa"), (1.0, "Pa"), (1e-3, "mPa")))


def per_second(value: float) -> str:
    """Return a speed in words."""
    return _in_units(value, ((1.0, "m/s"), (1e-2, "cm/s"), (1e-3, "mm/s"), (1e-6, "µm/s")))


def _in_units(value: float, units: tuple[tuple[float, str], ...]) -> str:
    """Return a number in the largest of `units`, descending, that is no larger than it, else in the smallest."""
    factor, unit = next((entry for entry in units if value >= entry[0]), units[-1])
    return f"{value / factor:g} {unit}"


# What has a sign runs through a pale middle (ColorBrewer's RdBu, safe for colour-blind eyes): strain from compressed to
# stretched, pressure from suction. All else runs from a grey that is seen on white to an ever darker hue of its own.
BLUE_TO_RED = ((33, 102, 172), (146, 197, 222), (247, 247, 247), (244, 165, 130), (178, 24, 43))
GREY = (190, 200, 210)
SCALES = {
    "strain": Scale("stretch strain", BLUE_TO_RED, ("blue", "red"), True, 1e-6, percent),
    "curvature": Scale("curvature", (GREY, (128, 186, 208), (66, 140, 214), (52, 80, 160), (36, 22, 96)),
                       ("grey", "dark blue"), False, 1e-2, per_metre),
    "force": Scale("contact force", (GREY, (253, 174, 97), (215, 48, 39), (120, 0, 38)),
                   ("grey", "dark red"), False, 1e-9, newtons),
    "speed": Scale("speed", (GREY, (140, 200, 185), (38, 152, 138), (0, 100, 92), (0, 48, 52)),
                   ("grey", "dark green"), False, 1e-6, per_second),
    "pressure": Scale("pressure", BLUE_TO_RED, ("blue", "red"), True, 1e-3, pascals),
    "shear": Scale("shear stress", (GREY, (196, 164, 206), (152, 98, 176), (104, 44, 134), (54, 6, 84)),
                   ("grey", "dark purple"), False, 1e-3, pascals),
}


def limit_of(values: NDArray[np.floating], scale: Scale) -> float:
    """Return the limit of the scale for a frame: 1, 2 or 5 times a power of ten within which WITHIN per cent are."""
    size = np.abs(values[values != 0.0])
    most = max(float(np.percentile(size, WITHIN)) if len(size) else 0.0, scale.least)
    power = 10.0 ** np.floor(np.log10(most))
    digit = next((d for d in (1, 2, 5) if most <= d * power * (1 + 1e-6)), 10)
    return float(f"{digit * power:.0e}")  # the nearest to what is written


def written_ends(scale: Scale, limit: float) -> tuple[str, str]:
    """Return the numbers at the ends of a scale."""
    high = scale.written(limit)
    return (f"−{high}", f"+{high}") if scale.signed else ("0", high)


def in_words(scale: Scale, limit: float) -> str:
    """Return what the colours of a scale mean."""
    (low, high), (first, last) = written_ends(scale, limit), scale.ends
    return f"{scale.label} from {low} ({first}) to {high} ({last})"


def colours_of(values: NDArray[np.floating], scale: Scale, limit: float) -> NDArray[np.uint8]:
    """Return colours of numbers, those of its ends beyond `limit`, shape [n, 3]."""
    stops = np.linspace(-limit if scale.signed else 0.0, limit, len(scale.stops))
    channels = [np.interp(values, stops, np.array(scale.stops, float)[:, c]) for c in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)
