"""Yarns and fabrics of a scene as model and state."""

from engine.contact.sphere_packing import Collisions, collisions_at_start
from engine.scene.edges import add_edges
from engine.scene.fabrics import add_fabric
from engine.scene.handles import handle_numbers
from engine.scene.materials import known_materials, yarn_material
from engine.scene.rods import add_rods
from engine.scene.schema import Box, Scene
from engine.scene.stack import add_contacts, levels
from engine.scene.weave import weave
from engine.yarns.assembly import YarnAssembly, YarnMaterial
from engine.yarns.model import YarnModel, YarnState


def build_yarns(scene: Scene) -> tuple[YarnModel, YarnState, Collisions | None]:
    """Return single yarns and then fabrics, each in their order, and how they collide where no point joins them."""
    model, state = _assembly(scene).build()
    return model, state, _collisions(scene, model, state)


def _assembly(scene: Scene) -> YarnAssembly:
    assembly = YarnAssembly()
    known = known_materials(scene.materials)

    def material(name: str) -> YarnMaterial:
        return yarn_material(known[name])

    handles = handle_numbers(scene.script)
    add_rods(assembly, scene, material, handles)
    level = levels(scene.fabrics, scene.contacts)
    patches = {fabric.name: weave(fabric) for fabric in scene.fabrics}
    first_yarn = {}
    for index, fabric in enumerate(scene.fabrics):
        first_yarn[fabric.name] = add_fabric(
            assembly, index, fabric, patches[fabric.name], material, level[fabric.name], handles)
    for contact in scene.contacts:
        lower, upper = contact.lower, contact.upper
        add_contacts(assembly, contact, patches[lower], patches[upper], first_yarn[lower], first_yarn[upper])
    # over an edge, a fabric slides on the fabric below it, the lowest one on the box
    below = {contact.upper: contact.friction for contact in scene.contacts}
    for box in scene.obstacles:
        if isinstance(box, Box):
            for fabric in scene.fabrics:
                friction = below.get(fabric.name, box.friction)
                add_edges(assembly, scene, box, fabric, patches[fabric.name], first_yarn[fabric.name], friction)
    return assembly


def _collisions(scene: Scene, model: YarnModel, state: YarnState) -> Collisions | None:
    if not scene.contact.self:
        return None
    contact = scene.contact
    return collisions_at_start(model, state, contact.thickness, contact.stiffness, contact.spacing)
