"""How large a scene is, found without building it."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

from engine.scene.edges import edge_crossings
from engine.scene.liquid_seeding import emitted_count, expected_count, own_pitch
from engine.scene.problems import Problem
from engine.scene.rods import held_points, piece_segments
from engine.scene.schema import Box, Scene
from engine.scene.stack import contact_count
from engine.scene.weave import weave

POINT_LIMIT = 2_000_000
PARTICLE_LIMIT = 20_000_000
FRAME_LIMIT = 1_000_000
STEP_LIMIT = 100_000_000


@dataclass(frozen=True)
class SizeEstimate:
    """What a scene asks for."""

    nodes: int
    points: int
    strands: int
    strand_vertices: int
    particles: int  # of liquid, those that come out up to the end among them
    frames: int
    steps: int  # at the default step


@dataclass(frozen=True)
class PartSize:
    """Points and nodes of yarns, strands and their vertices, and particles, that come from one part of a scene."""

    path: str
    points: int = 0
    nodes: int = 0
    strands: int = 0
    strand_vertices: int = 0
    particles: int = 0


def estimate(scene: Scene) -> SizeEstimate:
    """Return the size of a scene; nodes, points and vertices are exact, particles are
    so but for round shapes and what overlaps. The cost grows with the number
    of yarns, in patches with an outline with that of crossings."""
    parts = list(part_sizes(scene))
    frames = int(scene.duration * scene.fps + 1e-9) + 1
    steps_a_frame = ceil(1 / (scene.fps * scene.step.default) - 1e-9)
    return SizeEstimate(
        nodes=sum(part.nodes for part in parts),
        points=sum(part.points for part in parts),
        strands=sum(part.strands for part in parts),
        strand_vertices=sum(part.strand_vertices for part in parts),
        particles=sum(part.particles for part in parts),
        frames=frames,
        # frames shorten steps, so that one ends at every frame
        steps=max(ceil(scene.duration / scene.step.default - 1e-9), steps_a_frame * (frames - 1)),
    )


def part_sizes(scene: Scene) -> Iterator[PartSize]:
    """Yield the size of every part of a scene that brings points or vertices."""
    held = held_points(scene)
    for i, yarn in enumerate(scene.yarns):
        points = int(piece_segments(yarn).sum()) + 1 - len(held[yarn.name]) + len(yarn.eyelets)
        yield PartSize(f"yarns[{i}]", points, points)
    yield PartSize("crossings", len(scene.crossings), 2 * len(scene.crossings))
    patches = {fabric.name: weave(fabric) for fabric in scene.fabrics}
    for i, fabric in enumerate(scene.fabrics):
        ends, crossings = 2 * patches[fabric.name].yarn_count, patches[fabric.name].crossing_count
        alone = ends + patches[fabric.name].division_count(fabric.segments_per_crossing)
        yield PartSize(f"fabrics[{i}]", alone + crossings, alone + 2 * crossings)
    for i, contact in enumerate(scene.contacts):
        count = contact_count(contact, patches[contact.lower], patches[contact.upper])
        yield PartSize(f"contacts[{i}]", count, 2 * count)
    for i, box in enumerate(scene.obstacles):
        if isinstance(box, Box):
            for fabric in scene.fabrics:
                count = sum(len(yarn) for _, _, yarn, _ in edge_crossings(scene, box, fabric, patches[fabric.name]))
                yield PartSize(f"obstacles[{i}].edges", count, count)
    for i, group in enumerate(scene.strands):
        counts = group.vertex_counts
        yield PartSize(f"strands[{i}]", strands=len(counts), strand_vertices=sum(counts))
    if (liquid := scene.liquid) is not None:
        for i, shape in enumerate(liquid.initial):
            yield PartSize(f"liquid.initial[{i}]", particles=round(expected_count(shape, own_pitch(liquid, shape))))
        for i, nozzle in enumerate(liquid.sources):
            yield PartSize(f"liquid.sources[{i}]", particles=round(emitted_count(nozzle, liquid.pitch, scene.duration)))


def excesses(scene: Scene) -> Iterator[Problem]:
    """Yield what makes a scene too large to be simulated."""
    size = estimate(scene)
    if (total := size.points + size.strand_vertices) > POINT_LIMIT:
        largest = max(part_sizes(scene), key=lambda part: part.points + part.strand_vertices)
        message = f"the scene has {total:,} {'vertices' if size.strand_vertices else 'points'}, most of them here"
        yield Problem(largest.path, message, f"at most {POINT_LIMIT:,}")
    if size.particles > PARTICLE_LIMIT:
        largest = max(part_sizes(scene), key=lambda part: part.particles)
        yield Problem(largest.path, f"the liquid has {size.particles:.3g} particles, most of them here",
                      f"at most {PARTICLE_LIMIT:,}: a larger spacing or fewer particles_per_cell")
    if size.frames > FRAME_LIMIT:
        yield Problem("fps", f"gives {size.frames:,} frames", f"at most {FRAME_LIMIT:,}")
    if size.steps > STEP_LIMIT:
        yield Problem("step.default", f"gives {size.steps:,} steps", f"at most {STEP_LIMIT:,}")
