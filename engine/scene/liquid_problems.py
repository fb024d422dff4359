"""What must agree where a scene has liquid: shapes, nozzles, what repeats, the grid."""

from collections.abc import Iterator

import numpy as np

from engine.scene.liquid import LiquidCylinder, LiquidMesh
from engine.scene.liquid_bounds import bounds, origin, period
from engine.scene.liquid_materials import known_liquids
from engine.scene.liquid_seeding import own_pitch, places_in_box_around
from engine.scene.problems import Problem
from engine.scene.schema import Scene

LEAST_WAY = 1e-9  # length of a vector that still says which way
PLACE_LIMIT = 40_000_000  # that are looked at for what one mesh holds
CELL_LIMIT = 1_000_000  # along each axis, from where the grid begins to the ends of the box that the liquid may be in
WHOLE = 1e-6  # cells by which a length may differ from a number of whole ones


def _liquid(scene: Scene) -> Iterator[Problem]:
    """There is liquid at some time, and it is solved for in a way that its material has."""
    liquid = scene.liquid
    if liquid is None:
        return
    if not liquid.initial and not liquid.sources:
        yield Problem("liquid", "holds nothing", "one entry at least in initial or sources")
    material = known_liquids(scene.liquid_materials)[liquid.material]
    if scene.liquid_step.pressure == "explicit" and material.bulk_modulus is None:
        yield Problem("liquid_step.pressure", f"is explicit, but {liquid.material} is incompressible",
                      "implicit, or a material with a bulk_modulus")


def _shapes(scene: Scene) -> Iterator[Problem]:
    """Ways lead somewhere, nozzles flow for some time, and meshes are not looked through for ever."""
    liquid = scene.liquid
    if liquid is None:
        return
    for i, shape in enumerate(liquid.initial):
        path = f"liquid.initial[{i}]"
        if isinstance(shape, LiquidCylinder):
            yield from _way(f"{path}.axis", shape.axis)
        if isinstance(shape, LiquidMesh) and (count := places_in_box_around(shape, own_pitch(liquid, shape))) > PLACE_LIMIT:
            yield Problem(path, f"has {count:.3g} places for particles in the box around it",
                          f"at most {PLACE_LIMIT:,}: a larger spacing or fewer particles_per_cell")
    for i, nozzle in enumerate(liquid.sources):
        path = f"liquid.sources[{i}]"
        yield from _way(f"{path}.direction", nozzle.direction)
        if nozzle.end is not None and nozzle.end <= nozzle.begin:
            yield Problem(f"{path}.end", f"is {nozzle.end:g} s", f"more than begin, {nozzle.begin:g} s")


def _grid(scene: Scene) -> Iterator[Problem]:
    """What repeats has a length in cells that blocks of the grid divide, and cells can be counted."""
    liquid = scene.liquid
    if liquid is None:
        return
    for i, axis in enumerate(liquid.periodic):
        path = f"liquid.periodic[{i}]"
        if axis in liquid.periodic[:i]:
            yield Problem(path, f"repeats {axis}", "each axis once")
        elif liquid.repeated is None:
            yield Problem(path, f"does not say after which length along {axis}", "a liquid with a tank, or with bounds")
        else:
            cells = period(liquid, axis)
            whole = round(cells)
            if abs(cells - whole) > WHOLE or whole < 1 or (whole != 4 and whole % 8):
                box = "the tank has" if liquid.tank is not None else "bounds have"
                yield Problem(path, f"{box} {cells:.6g} cells along {axis}", "4 cells, or a multiple of 8")
    cells = float(np.max(np.abs(np.array(bounds(scene, liquid)) - origin(scene, liquid)))) / liquid.spacing
    if cells > CELL_LIMIT:
        path = "liquid.spacing" if liquid.bounds is None else "liquid.bounds"
        yield Problem(path, f"the box that the liquid may be in ends {cells:.3g} cells away from where its grid begins",
                      f"at most {CELL_LIMIT:,}: a larger spacing, or narrower bounds")


def _way(path: str, way: tuple[float, float, float]) -> Iterator[Problem]:
    if not np.linalg.norm(way) > LEAST_WAY:
        yield Problem(path, "has no length", "a way that leads somewhere")


liquid_problems = (_liquid, _shapes, _grid)  # each relies on those before it
