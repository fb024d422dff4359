"""Numbers and names as people read them, for pages and terminal alike."""

from datetime import datetime
from typing import Any

LABELS = {
    "lagrangian": "Lagrangian", "eol_intra": "EoL within a fabric", "eol_inter": "EoL between fabrics",
    "eol_inter_max": "EoL between fabrics, most", "eil": "EIL", "eil_max": "EIL, most", "contacts": "contacts",
    "contacts_max": "contacts between fabrics or strands, most", "strand_vertices": "vertices of strands",
    "particles": "particles of liquid", "particles_max": "particles of liquid, most", "grid_cells": "cells of the grid",
    "grid_cells_max": "cells of the grid, most", "collisions": "pairs that collide", "collisions_max": "pairs that collide, most",
    "simulated_s": "simulated", "steps": "steps", "rejected_steps": "rejected steps", "dt_default": "default step",
    "dt_min": "smallest step", "compile_s": "compiling", "wall_s": "wall time", "s_per_step": "one step",
    "newton_residual_max": "Newton residual, largest", "newton_iterations": "Newton iterations",
    "linear_iterations": "linear iterations", "contact_gap_max": "contact gap, largest (radii)",
    "penetration_max": "penetration, deepest (radii)", "momentum_drift": "momentum drift",
    "energy_drift": "energy drift", "volume_drift": "volume drift",
}
ROUNDED = 0.9995  # from where three digits show a whole
SECONDS = {"simulated_s", "compile_s", "wall_s", "dt_default", "dt_min", "s_per_step"}


def label(key: str) -> str:
    """Return the name of a report's or a progress event's key."""
    return LABELS.get(key, key.replace("_", " "))


def duration(seconds: float | None) -> str:
    """Return a time span: `3.2 ms`, `4.1 s`, `3 min 20 s`, `2 h 5 min`; a dash while unknown."""
    if seconds is None:
        return "–"
    if 0 < seconds < ROUNDED * 1e-3:
        return f"{seconds * 1e6:.3g} µs"
    if 0 < seconds < ROUNDED:
        return f"{seconds * 1e3:.3g} ms"
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def size(count: float) -> str:
    """Return a number of bytes: `512 B`, `1.4 MB`."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def number(value: float | None) -> str:
    """Return a number with three digits that count, thousands grouped; a dash while unknown."""
    if value is None:
        return "–"
    if isinstance(value, int) or (value == int(value) and abs(value) < 1e15):
        return f"{int(value):,}".replace(",", " ")
    if 1e-3 <= abs(value) < 1e5:
        return f"{value:.3g}"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}·10{str(int(exponent)).translate(_SUPERSCRIPT)}"


def extent(estimate: dict[str, int]) -> str:
    """Return how large a scene is: `231 517 points`, `100 strands with 1 600 vertices`, `up to 37 000 particles`."""
    if particles := estimate.get("particles", 0):
        return f"up to {number(particles)} particles"
    strands, vertices = estimate.get("strands", 0), estimate.get("strand_vertices", 0)
    if vertices:
        return f"{number(strands)} {'strand' if strands == 1 else 'strands'} with {number(vertices)} vertices"
    return f"{number(estimate['points'])} points"


def quantity(key: str, value: Any) -> str:
    """Return the value of a report's key with its unit; of a distribution its median and its end."""
    if isinstance(value, dict):
        return ", ".join(f"{name} {quantity(key, part)}" for name, part in value.items())
    if isinstance(value, int | float) and not isinstance(value, bool):
        return duration(value) if key in SECONDS else number(value)
    return str(value)


def clock(timestamp: str | None) -> str:
    """Return an ISO 8601 time in this machine's zone, date and minute."""
    return "–" if timestamp is None else datetime.fromisoformat(timestamp).astimezone().strftime("%d %b %H:%M")


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
