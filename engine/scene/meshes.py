"""Obstacles and bodies of liquid given as meshes: read from files, checked, and sampled."""

from collections.abc import Iterator
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from engine.contact.surface import SampledSurface, Surface, sampled, samples_along
from engine.scene.beside import read_beside, unread
from engine.scene.liquid import LiquidMesh
from engine.scene.materials import known_materials
from engine.scene.mesh_shapes import SHAPE_VERTEX_LIMIT, later_shapes, shape_problems
from engine.scene.problems import Problem, SceneError, shown
from engine.scene.schema import Mesh, Scene

FILE_TYPES = ("stl", "obj", "ply", "glb")
FILE_LIMIT = 64_000_000  # bytes
FACE_LIMIT = 100_000  # of all meshes of a scene together, so that the scene with them in it can be read again
SAMPLE_LIMIT = 4_000_000  # of the distance to one mesh
DIVISIONS = 64  # of the longest side of a mesh, by default
LIQUID_REACH = 2.0  # cells of its grid over which liquid asks how far obstacles are


def read_mesh_files(document: Any, directory: Path | None) -> None:
    """Replace `file` of every mesh in a scene's `document` by the vertices and faces in it, and those of shapes by vertices.

    Files are looked up in `directory`, that of the scene's own file, and nowhere else; a scene that comes from no file
    has none (None), and its meshes are left as they are, for `mesh_problems` to refuse. Raises SceneError.
    """
    for place, entry in _mesh_entries(document):
        if directory is None:
            continue
        shapes = entry.get("shapes") or []
        if isinstance(name := entry.get("file"), str) and not entry.get("vertices") and not entry.get("faces"):
            surface = _read(f"{place}.file", name, directory, as_it_is=bool(shapes))
            del entry["file"]
            entry["vertices"], entry["faces"] = surface.vertices.tolist(), surface.faces.tolist()
        for k, shape in enumerate(shapes if isinstance(shapes, list) else []):
            if isinstance(shape, dict) and isinstance(name := shape.get("file"), str) and not shape.get("vertices"):
                path = f"{place}.shapes[{k}].file"
                surface = _read(path, name, directory, as_it_is=True)
                if surface.faces.tolist() != entry.get("faces"):
                    raise SceneError([Problem(path, f"{shown(name)} has other triangles than the mesh",
                                              "the same ones, their vertices in the same order")])
                del shape["file"]
                shape["vertices"] = surface.vertices.tolist()


def mesh_problems(scene: Scene) -> Iterator[Problem]:
    """Yield what is wrong with the meshes of a scene."""
    meshes: list[tuple[str, Mesh | LiquidMesh]] = [
        (f"obstacles[{i}]", mesh) for i, mesh in enumerate(scene.obstacles) if isinstance(mesh, Mesh)]
    bodies = scene.liquid.initial if scene.liquid is not None else ()
    meshes += [(f"liquid.initial[{i}]", body) for i, body in enumerate(bodies) if isinstance(body, LiquidMesh)]
    if sum(len(mesh.faces) for _, mesh in meshes) > FACE_LIMIT:
        path = "obstacles" if isinstance(meshes[0][1], Mesh) else "liquid.initial"
        yield Problem(path, "their meshes have too many triangles", f"at most {FACE_LIMIT:,} in all")
    shapes = [shape for mesh in scene.obstacles if isinstance(mesh, Mesh) for shape in mesh.shapes]
    if sum(len(shape.vertices) for shape in shapes) > SHAPE_VERTEX_LIMIT:
        yield Problem("obstacles", "the shapes of their meshes have too many vertices", f"at most {SHAPE_VERTEX_LIMIT:,} in all")
    for path, mesh in meshes:
        if mesh.file is not None and (mesh.vertices or mesh.faces):
            yield Problem(f"{path}.file", "stands beside vertices or faces", "one of both")
        elif mesh.file is not None:
            yield unread(f"{path}.file", "vertices and faces")
        else:
            problems = list(_surface_problems(path, mesh))
            yield from problems
            if isinstance(mesh, Mesh) and not problems:
                yield from _sample_problems(path, mesh, contact_reach(scene))
                yield from shape_problems(path, mesh)


def contact_reach(scene: Scene) -> float:
    """Return the largest distance at which an obstacle pushes anything in the scene [m]."""
    known = known_materials(scene.materials)
    yarns = [known[yarn.material].radius for yarn in scene.yarns]
    fabrics = [
        max(known[name].radius for name in (fabric.material, fabric.weft_material or fabric.material))
        if fabric.obstacle_distance is None else fabric.obstacle_distance for fabric in scene.fabrics]
    strands = [group.widest(known[group.material].radius) for group in scene.strands]
    liquid = [LIQUID_REACH * scene.liquid.spacing] if scene.liquid is not None else []
    return max(yarns + fabrics + strands + liquid)


@lru_cache(maxsize=8)  # a job's simulation and its recorder ask for the same
def sampled_mesh(mesh: Mesh, reach: float) -> SampledSurface:
    """Return a mesh that has no problems, sampled so that contact at distances up to `reach` [m] is felt."""
    surface = surface_of(mesh)
    return sampled(surface, mesh.resolution or _default_resolution(surface), reach, later_shapes(mesh, surface))


def _default_resolution(surface: Surface) -> float:
    return float(surface.extent.max()) / DIVISIONS


def surface_of(mesh: Mesh | LiquidMesh) -> Surface:
    """Return the surface with vertices at one place made one, triangles counter-clockwise from outside."""
    import trimesh  # takes longer to import than all else that a scene without meshes needs

    merged = trimesh.Trimesh(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64), process=True)
    faces = np.asarray(merged.faces, np.int64)
    with np.errstate(invalid="ignore"):  # its centre of mass comes along, which a flat one has none of
        inside_out = merged.volume < 0.0
    return Surface(np.asarray(merged.vertices, float), faces[:, ::-1] if inside_out else faces)


def _mesh_entries(document: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield path and entry of all meshes in a document that may hold anything."""
    liquid = document.get("liquid")
    initial = liquid.get("initial") if isinstance(liquid, dict) else None
    for path, entries in (("obstacles", document.get("obstacles")), ("liquid.initial", initial)):
        for i, entry in enumerate(entries if isinstance(entries, list) else []):
            if isinstance(entry, dict) and entry.get("shape") == "mesh":
                yield f"{path}[{i}]", entry


def _surface_problems(path: str, mesh: Mesh | LiquidMesh) -> Iterator[Problem]:
    if len(mesh.vertices) < 4 or len(mesh.faces) < 4:
        yield Problem(path, "has no body", "a file, or at least four vertices and four faces")
        return
    if (largest := max(map(max, mesh.faces))) >= len(mesh.vertices):
        yield Problem(f"{path}.faces", f"one has vertex {largest}", f"0 to {len(mesh.vertices) - 1}")
        return
    import trimesh

    surface = surface_of(mesh)
    body = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    extent = float(surface.extent.max())
    if not (body.is_watertight and body.is_winding_consistent):
        yield Problem(path, "is not watertight: its distance has no sign",
                      "a closed surface, two triangles at every edge, all turned the same way")
    elif not body.area_faces.min() > 1e-14 * extent**2 or not body.volume > 1e-9 * extent**3:
        yield Problem(path, "has triangles without area, or no volume", "a body")


def _sample_problems(path: str, mesh: Mesh, reach: float) -> Iterator[Problem]:
    surface = surface_of(mesh)
    spacing = mesh.resolution or _default_resolution(surface)
    count = float(np.prod(samples_along(surface.extent, spacing, reach))) * (1 + len(mesh.shapes))
    if count > SAMPLE_LIMIT:
        yield Problem(f"{path}.resolution", f"{spacing:.3g} m takes {count:.2g} samples of the distance",
                      f"at most {SAMPLE_LIMIT:,}: a coarser resolution")


def _read(path: str, name: str, directory: Path, as_it_is: bool) -> Surface:
    """Read a mesh, with all its vertices in their order if `as_it_is`; `path` is where the scene names it."""
    content, kind = read_beside(path, name, directory, FILE_TYPES, FILE_LIMIT)
    try:
        import trimesh

        # bytes lead to no other files, such as materials
        found = trimesh.load_scene(BytesIO(content), file_type=kind, process=not as_it_is, maintain_order=as_it_is).to_mesh()
    except Exception as error:  # whatever a reader of a foreign format comes upon
        raise SceneError([Problem(path, f"{shown(name)} cannot be read as {kind}: {type(error).__name__}")]) from None
    return Surface(np.asarray(found.vertices, float), np.asarray(found.faces, np.int64))
