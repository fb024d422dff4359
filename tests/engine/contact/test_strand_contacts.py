"""Sets of contacts, and what of strands and solids gets into them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.contact.obstacles import ObstacleKind, Obstacles, motion
from engine.contact.strand_contacts import CLOSE_BY, MENDING, MOST, SOLID, Contacts, Touching, no_contacts
from engine.geometry.handles import Handles, no_handles
from engine.strands.assembly import StrandAssembly, StrandMaterial

NYLON = StrandMaterial(density=1150.0, young=2e9, shear=0.75e9)
RADIUS, H = 0.05, 1e-3
FLOOR = Obstacles(np.array([ObstacleKind.PLANE]), np.zeros((1, 3)), np.eye(3)[None], np.ones((1, 3)), np.array([0.4]))


def strands(*curves, held=False, radius=RADIUS):
    """A model and state of strands through curves, with friction 0.1, 0.2, ..."""
    assembly = StrandAssembly()
    for k, curve in enumerate(curves):
        assembly.strand(np.asarray(curve, float), radius, NYLON, friction=0.1 * (k + 1), held=np.full((len(curve), 4), held))
    return assembly.build()


def crossing(height: float):
    """Two strands that cross, one over the other."""
    return strands([[-1.0, 0, 0], [0.3, 0, 0], [1.0, 0, 0]], [[0.0, -1.0, height], [0.0, 0.4, height], [0.0, 1.0, height]])


def falling(state, depth: float):
    """The second strand comes down."""
    moved = np.zeros_like(state.x)
    moved[3:, 2] = -depth
    return moved


def some_contacts(seed: int = 0, number: int = 12) -> Contacts:
    """Contacts of all sorts between edges of 10 vertices, or with two solids."""
    rng = np.random.default_rng(seed)
    other = np.where(rng.random(number) < 0.5, rng.integers(5, 9, number), SOLID - rng.integers(0, 2, number))
    edge = np.column_stack([rng.integers(0, 4, number), other])
    share = rng.choice([0.0, 0.3, 1.0], (number, 2))
    normal = rng.normal(size=(number, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    carried = (edge[:, 1:] < 0) * rng.normal(size=(number, 3))
    return Contacts(edge, share, normal, rng.random(number), np.ones(number), np.ones(number), np.zeros(number), carried,
                    rng.random(number), rng.normal(size=(number, 3)) * (rng.random((number, 1)) < 0.7))


def test_strands_that_cross_touch_where_they_are_on_the_way():
    model, state = crossing(0.5)
    found = Touching(model, 0.0).between_strands(state.x, falling(state, 1.0), H, no_contacts())
    np.testing.assert_array_equal(found.edge, [[0, 3]])
    np.testing.assert_allclose(found.share, [[1.0 / 1.3, 1.0 / 1.4]])
    np.testing.assert_allclose(found.normal, [[0.0, 0.0, -1.0]], atol=1e-12)
    np.testing.assert_allclose([found.apart[0], found.touch[0], found.kept[0]], [0.5, 2 * RADIUS, 2 * RADIUS])
    assert found.friction[0] == pytest.approx(np.sqrt(0.1 * 0.2))
    moved = falling(state, 0.41)
    assert found.overlap(state.x + moved, moved) == pytest.approx(0.1)
    assert not len(Touching(model, 0.0).between_strands(state.x, falling(state, 1.0), H, found).edge) == 0


def test_radii_of_an_elliptic_section_count_by_their_geometric_mean():
    model, _ = strands([[0.0, 0, 0], [1.0, 0, 0]], radius=np.array([0.02, 0.08]))
    np.testing.assert_allclose(Touching(model, 0.0).radius, 0.04)


@pytest.mark.parametrize(("reach", "height", "number"), [(0.0, 0.12, 0), (0.03, 0.12, 1), (0.03, 0.14, 0)])
def test_cohesion_reaches_beyond_the_surface(reach, height, number):
    model, state = crossing(height)
    assert len(Touching(model, reach).between_strands(state.x, 0 * state.x, H, no_contacts()).edge) == number


@pytest.mark.parametrize("overlap", [0.5 * MOST, 2.0 * MOST])
def test_overlaps_do_not_grow_and_are_mended_at_a_bounded_rate(overlap):
    model, state = crossing(2 * RADIUS * (1.0 - overlap))
    touching = Touching(model, 0.0)
    kept = [touching.between_strands(state.x, 0 * state.x, h, no_contacts()).kept[0] for h in (1e-6, 1e-3, 1.0)]
    assert kept[0] >= state.x[3, 2] - 1e-15 and np.all(np.diff(kept) >= 0.0) and kept[-1] <= 2 * RADIUS + 1e-15
    mended = 2 * RADIUS * min(overlap, MOST)
    assert kept[1] == pytest.approx(state.x[3, 2] + H / MENDING * mended)
    assert kept[-1] == pytest.approx(state.x[3, 2] + mended)


def test_overlaps_where_hardly_anything_can_yield_stay():
    model, state = crossing(2 * RADIUS * 0.9)
    held = np.ones_like(model.held)
    held[1, :3] = False
    kept = Touching(model._replace(held=held), 0.0).between_strands(state.x, 0 * state.x, H, no_contacts())
    free = ~held[kept.edge, 0]
    share = np.where(free, 1.0 - kept.share, 0.0) + np.where(~held[kept.edge + 1, 0], kept.share, 0.0)
    mended = kept.kept > state.x[3, 2] + 1e-12
    np.testing.assert_array_equal(mended, (share**2).sum(axis=1) > 0.1)


def test_the_floor_touches_vertices_and_is_told_by_its_number():
    model, state = strands([[0.0, 0, 0.2], [1.0, 0, 0.2], [2.0, 0, 0.04]])
    two = replace(FLOOR, kind=FLOOR.kind.repeat(2), centre=np.array([[0.0, 0, -9.0], [0.0, 0, 0]]),
                  rotation=FLOOR.rotation.repeat(2, 0), size=FLOOR.size.repeat(2, 0), friction=np.array([0.3, 0.4]))
    moved = np.tile([0.0, 0.0, -0.3], (3, 1))
    found = Touching(model, 0.0).with_solids(state.x, moved, H, motion(two, no_handles(), 0.0, 1.0), no_contacts())
    np.testing.assert_array_equal(found.edge[:, 1], SOLID - 1)
    places = found.edge[:, 0] + found.share[:, 0]
    np.testing.assert_array_equal(np.unique(places), [0.0, 1.0, 2.0])
    np.testing.assert_allclose(found.friction, 0.4)
    np.testing.assert_allclose(found.apart, state.x[places.astype(int), 2])
    np.testing.assert_array_equal(found.carried, 0.0)


def test_a_floor_that_moves_and_turns_carries_the_places_on_it():
    model, state = strands([[0.0, 0, 0.2], [1.0, 0, 0.2]])
    handles = Handles(np.array([0, 2]), np.array([0.0, 1.0]), offset=np.array([[0.0, 0, 0], [0.0, 0, 0.3]]),
                      angles=np.array([[0.0, 0, 0], [0.0, 0, 30.0]]), pivot=np.zeros((1, 3)))
    carried = motion(replace(FLOOR, handle=np.zeros(1, np.int64)), handles, 0.0, 1.0)
    found = Touching(model, 0.0).with_solids(state.x, 0 * state.x, H, carried, no_contacts())
    moved = Rotation.from_euler("z", 30, degrees=True).apply(state.x) + np.array([0.0, 0.0, 0.3]) - state.x
    np.testing.assert_allclose(found.carried, moved, atol=1e-12)
    np.testing.assert_allclose(found.displaced(moved), 0.0, atol=1e-12)  # who goes along with the floor does not slip


def test_what_is_held_altogether_has_no_contacts():
    model, state = strands([[-1.0, 0, 0], [1.0, 0, 0]], [[0.0, -1.0, 0.06], [0.0, 1.0, 0.06]], held=True)
    touching = Touching(model, 0.0)
    assert not len(touching.between_strands(state.x, 0 * state.x, H, no_contacts()).edge)
    assert not len(touching.with_solids(state.x, 0 * state.x, H, motion(FLOOR, no_handles(), 0.0, 1.0), no_contacts()).edge)


def test_keys_tell_edges_and_places_on_solids_apart():
    contacts = some_contacts(number=200)
    place = np.where(contacts.edge[:, 1] >= 0, -1.0, contacts.share[:, 0])
    names = np.unique(np.column_stack([contacts.edge, place]), axis=0)
    assert len(np.unique(contacts.key)) == len(names)
    assert (contacts.key >= -(2**62)).all()


def test_forces_come_back_by_their_keys():
    contacts = some_contacts(1)
    key, force = contacts.pressing()
    assert (np.diff(key) > 0).all() and np.any(force != 0.0, axis=1).all()
    np.testing.assert_allclose(force.sum(axis=0), contacts.force.sum(axis=0))
    fresh = contacts._replace(force=np.zeros_like(contacts.force))
    back = fresh.with_forces(key, force)
    for number, own in enumerate(contacts.key):
        np.testing.assert_allclose(back.force[number], contacts.force[contacts.key == own].sum(axis=0))
    assert fresh.with_forces(key[:0], force[:0]) is fresh
    assert not fresh.with_forces(key[:1], force[:1]).force[contacts.key != key[0]].any()


def test_displacements_and_forces_on_vertices_do_the_same_work():
    contacts, rng = some_contacts(2), np.random.default_rng(2)
    contacts = contacts._replace(carried=np.zeros_like(contacts.carried))
    moved = rng.normal(size=(10, 3))
    on_vertices = contacts.on_vertices(contacts.force, 10)
    assert np.sum(on_vertices * moved) == pytest.approx(np.sum(contacts.force * contacts.displaced(moved)))
    strands_only = contacts._replace(force=contacts.force * (contacts.edge[:, 1:] >= 0))
    np.testing.assert_allclose(strands_only.on_vertices(strands_only.force, 10).sum(axis=0), 0.0, atol=1e-12)
    sizes = np.linalg.norm(contacts.force, axis=1)[:, None]
    assert contacts.on_vertices(sizes, 10, second=1.0).sum() == pytest.approx(np.sum(sizes * (1 + (contacts.edge[:, 1:] >= 0))))


def test_together_contacts_are_in_the_order_of_their_edges():
    both = some_contacts(3).and_also(some_contacts(4))
    assert len(both.edge) == 24 and sorted(both.edge.tolist()) == both.edge.tolist()
    np.testing.assert_allclose(both.force.sum(), some_contacts(3).force.sum() + some_contacts(4).force.sum())
    assert len(no_contacts().and_also(some_contacts()).edge) == 12


def test_strands_of_contacts():
    model, _ = crossing(1.0)
    touching = Touching(model, 0.0)
    contacts = some_contacts()._replace(edge=np.array([[0, SOLID]] * 12))
    np.testing.assert_array_equal(touching.strands_of(contacts), [True, False])
    np.testing.assert_array_equal(touching.strands_of(contacts._replace(edge=np.array([[0, 3]] * 12))), [True, True])


def test_contacts_met_anew_take_the_place_and_the_forces_of_those_close_by():
    old = some_contacts(number=6)._replace(edge=np.array([[0, 10], [1, 11], [2, 12], [3, SOLID], [4, SOLID], [5, 13]]))
    old = old._replace(share=np.array([[0.5, 0.5], [0.5, 0.5], [0.5, 0.5], [0.5, 0.0], [0.0, 0.0], [0.5, 0.5]]))
    met = Contacts(*(values[:5].copy() for values in old))
    # close by, too far along the second edge, at the very place, far along the solid, within an edge that begins at a contact
    moved = [[0.45, 0.55], [0.5, 0.5 + 2 * CLOSE_BY], [0.5, 0.5], [0.5 - 2 * CLOSE_BY, 0.0], [0.5 * CLOSE_BY, 0.0]]
    met = met._replace(share=np.array(moved), force=np.zeros((5, 3)))
    made = old.renewed(met)
    assert len(made.edge) == 6 + 5 - 2
    np.testing.assert_allclose(made.force.sum(axis=0), old.force.sum(axis=0))
    for replaced in (0, 2):
        at = np.flatnonzero(made.edge[:, 0] == replaced)
        np.testing.assert_allclose(made.share[at], [moved[replaced]])
        np.testing.assert_allclose(made.force[at], old.force[replaced : replaced + 1])


def test_contacts_met_first_are_all_there_are():
    met = some_contacts()
    np.testing.assert_array_equal(no_contacts().renewed(met).edge, no_contacts().and_also(met).edge)
    np.testing.assert_array_equal(met.renewed(no_contacts()).edge, met.edge)


def test_what_cannot_part_keeps_the_distance_it_had_and_begins_without_force():
    model, state = crossing(2 * RADIUS * 0.95)
    found = Touching(model, 0.0).between_strands(state.x, 0 * state.x, H, no_contacts())
    found = found._replace(force=np.ones_like(found.force))
    assert found.mended[0] > 0.0
    left = found.unmended(np.zeros(len(found.edge), bool))
    np.testing.assert_array_equal(left.kept, found.kept)
    np.testing.assert_array_equal(left.force, found.force)
    still = found.unmended(np.ones(len(found.edge), bool))
    assert still.kept[0] == pytest.approx(state.x[3, 2]) and not still.mended.any() and not still.force.any()
    np.testing.assert_array_equal(still.unmended(np.ones(len(found.edge), bool)).kept, still.kept)


def test_the_gap_is_what_the_law_keeps_from_closing():
    model, state = crossing(0.5)
    touching = Touching(model, 0.0)
    for depth in (0.41, 0.8):
        found = touching.between_strands(state.x, falling(state, depth), H, no_contacts())
        np.testing.assert_allclose(found.gap(np.zeros_like(state.x)), 0.5 - 2 * RADIUS)
        np.testing.assert_allclose(found.gap(falling(state, 0.1)), 0.4 - 2 * RADIUS)


def test_some_of_the_contacts_change_and_the_others_lose_their_force():
    contacts = some_contacts()
    which = np.arange(12) % 3 == 0
    some = contacts.those(which)
    assert len(some.edge) == 4
    after = contacts.with_those(which, some._replace(force=2.0 * some.force, kept=some.kept + 1.0))
    np.testing.assert_array_equal(after.force[which], 2.0 * contacts.force[which])
    assert not after.force[~which].any()
    np.testing.assert_array_equal(after.kept, contacts.kept + which)
    np.testing.assert_array_equal(after.normal, contacts.normal)


def test_what_presses_or_comes_to_on_one_of_the_ways_may_press():
    model, state = crossing(0.5)
    still, found = np.zeros_like(state.x), Touching(model, 0.0).between_strands(state.x, falling(state, 0.45), H, no_contacts())
    assert not found.may_press(0.01, still, falling(state, 0.39)).any()
    assert found.may_press(0.01, still, falling(state, 0.3995)).all()
    assert found._replace(force=np.ones_like(found.force)).may_press(0.01, still).all()
