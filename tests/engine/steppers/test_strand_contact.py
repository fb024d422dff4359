"""Steps of strands in contact: what is conserved, what does not depend on threads, and that nothing goes through anything."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from engine.contact.obstacles import ObstacleKind, ObstacleMotion, Obstacles, motion
from engine.contact.strand_contacts import MENDING, MOST
from engine.geometry.handles import no_handles
from engine.steppers.strands import StrandStepper
from engine.strands.assembly import StrandAssembly, StrandMaterial
from engine.strands.loads import StrandLoads
from engine.strands.observe import energies, momentum
from engine.strands.settings import StrandSettings
from engine.validate.contact_crossings import crossed
from engine.validate.contact_impacts import fate, random_impact
from tests.engine.threads import on_one_and_two_threads

HAIR = StrandMaterial(density=1300.0, young=3e9, shear=1e9)
RADIUS, H = 5e-5, 1e-3
ZERO, DOWN = np.zeros(3), np.array([0.0, 0.0, -9.81])


def two_that_hit(speed: float = 2.0, friction: float = 0.3, vertices: int = 16):
    """A strand at rest, and one that flies at it across."""
    s = np.linspace(-0.02, 0.02, vertices)
    assembly = StrandAssembly()
    assembly.strand(np.column_stack([s, 0 * s, 0 * s]), RADIUS, HAIR, friction=friction)
    assembly.strand(np.column_stack([0 * s + 1e-3, s, 0 * s + 1e-3]), RADIUS, HAIR, friction=friction)
    model, state = assembly.build()
    state.velocity[vertices:, 2] = -speed
    return model, state


def floor(friction: float = 0.3) -> ObstacleMotion:
    plane = Obstacles(np.array([ObstacleKind.PLANE]), np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.array([friction]))
    return motion(plane, no_handles(), 0.0, H)


def energy(model, state) -> float:
    return sum(energies(model, state, ZERO).values())


def drift(settings: StrandSettings) -> float:
    """The largest change of momentum in a collision, over the momentum."""
    model, state = two_that_hit()
    stepper, start, contacts, off = StrandStepper(model, ZERO, settings), momentum(model, state), 0, 0.0
    for _ in range(12):
        report = stepper.step(state, H)
        assert report.accepted, report.reason
        contacts += report.contacts
        off = max(off, float(np.abs(momentum(model, state) - start).max() / np.abs(start).max()))
    assert contacts > 0
    return off


def test_momentum_of_strands_that_hit_each_other_is_kept():
    assert drift(StrandSettings(contact_tolerance=1e-9, tolerance=1e-10)) <= 1e-8


@pytest.mark.xfail(strict=True, reason="the sides of a contact are springs of their own, alike to its tolerance")
def test_momentum_is_kept_with_settings_as_they_are():
    assert drift(StrandSettings()) <= 1e-8


def test_momentum_is_kept_to_the_tolerance_of_contact_at_least():
    assert drift(StrandSettings()) <= 1e-4
    assert drift(StrandSettings(contact_tolerance=1e-5)) <= 1e-6


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("speed", [0.1, 2.0, 20.0])
def test_contact_never_raises_the_energy(speed, friction):
    model, state = two_that_hit(speed, friction)
    stepper, start, contacts = StrandStepper(model, ZERO), energy(model, state), 0
    last, time, h = start, 0.0, H
    while time < 0.04 / max(speed, 1.0):
        report = stepper.step(state, h)
        if report.accepted:
            time, h = time + h, min(2 * h, H)
            contacts += report.contacts
            assert energy(model, state) <= last + 1e-6 * start
            last = energy(model, state)
        else:
            h /= 2
    assert contacts > 0 or speed < 1.0


def hanging(count: int):
    """Strands side by side and across each other over a floor, which fall on it."""
    assembly, rng = StrandAssembly(), np.random.default_rng(3)
    for k in range(count):
        s = np.linspace(-0.01, 0.01, 8 + k % 3)
        points = np.zeros((len(s), 3))
        points[:, k % 2], points[:, 2] = s, 1.5 * RADIUS + 2.1 * RADIUS * k
        points[:, (k + 1) % 2] = rng.uniform(-0.006, 0.006)
        assembly.strand(points, RADIUS, HAIR, friction=0.3)
    model, state = assembly.build()
    state.velocity[:, 2] = -0.5
    return model, state


def test_two_threads_give_the_same_bits():
    def moved():
        model, state = hanging(16)
        stepper = StrandStepper(model, DOWN)
        reports = [stepper.step(state, H, obstacles=floor()) for _ in range(2)]
        assert all(report.accepted for report in reports) and reports[-1].contacts > 16
        return vars(state)

    one, two = on_one_and_two_threads(moved)
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name])


@pytest.mark.parametrize("seed", range(60))
def test_nothing_goes_through_anything(seed):
    through, _ = fate(random_impact(seed), H)
    assert not through


def test_impacts_are_impacts():
    """What the seeds are: fast and slow, with strands and all solids, at rest and moving; and without contact all go through."""
    impacts = [random_impact(seed) for seed in range(60)]
    kinds = {impact.obstacles.kind[0] for impact in impacts if impact.obstacles is not None}
    assert kinds == set(ObstacleKind) - {ObstacleKind.MESH}
    assert sum(impact.state.velocity.any() for impact in impacts) not in (0, 60)
    for impact in impacts[::6]:
        model, x = impact.model, impact.state.x
        flown = impact.duration * impact.state.velocity
        first, second = (np.arange(a, b - 1) for a, b in pairwise(model.start))
        assert crossed(x, flown, first, second)


@examples(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_judge_of_crossings_sees_all_and_no_more(seed):
    """Two segments through one place on the way cross; where the way ends before it, or a segment does, they do not."""
    rng = np.random.default_rng(seed)
    x, flown, (s, t) = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.uniform(0.05, 0.95, 2)
    when = rng.uniform(0.1, 0.9)
    place = x + when * flown
    x[:2] += (1 - t) * place[2] + t * place[3] - (1 - s) * place[0] - s * place[1]
    a, b = np.array([0]), np.array([2])
    assert crossed(x, flown, a, b)
    ways = (x + u * flown for u in np.linspace(0.0, 0.99 * when, 400))
    volumes = np.array([np.linalg.det([y[1] - y[0], y[3] - y[2], y[2] - y[0]]) for y in ways])
    if (volumes > 0).all() or (volumes < 0).all():
        assert not crossed(x, 0.99 * when * flown, a, b)


def test_a_rejected_step_changes_nothing_and_half_of_it_is_taken():
    rejected = 0
    for seed in range(0, 12):
        impact, h = random_impact(seed), 4e-3
        stepper = StrandStepper(impact.model, ZERO, StrandSettings(max_newton=15))
        before = impact.state.copy()
        while not stepper.step(impact.state, h, obstacles=impact.obstacle_motion(0.0, h)).accepted:
            rejected, h = rejected + 1, 0.5 * h
            for name, values in vars(before).items():
                np.testing.assert_array_equal(values, getattr(impact.state, name))
            assert h > 1e-6
        assert np.isfinite(impact.state.x).all()
    assert rejected > 0


def test_contacts_that_do_not_agree_are_a_reason():
    model, state = two_that_hit()
    before = state.copy()
    report = StrandStepper(model, ZERO, StrandSettings(max_rounds=1)).step(state, H)
    assert not report.accepted and report.reason == "strands and contacts did not agree"
    np.testing.assert_array_equal(state.x, before.x)


def test_contact_can_be_off():
    model, state = two_that_hit()
    stepper = StrandStepper(model, ZERO, StrandSettings(contact="none"))
    assert stepper.step(state, H).contacts == 0
    np.testing.assert_allclose(state.x[16:, 2], 1e-3 - 2.0 * H)


def at_rest(steps: int = 60):
    """A damped strand that has come to rest on the floor, with its stepper and last report."""
    s = np.linspace(0.0, 0.02, 12)
    assembly = StrandAssembly()
    assembly.strand(np.column_stack([s, 0 * s, 0 * s + RADIUS]), RADIUS, replace(HAIR, damping=1e-3), friction=0.3)
    model, state = assembly.build()
    stepper = StrandStepper(model, DOWN)
    for _ in range(steps):
        report = stepper.step(state, H, obstacles=floor())
        assert report.accepted
    return model, state, report


def test_what_rests_is_carried_by_its_contacts():
    model, state, report = at_rest()
    weight = model.mass.sum() * 9.81
    np.testing.assert_allclose(state.contact_force.sum(axis=0), [0.0, 0.0, weight], rtol=1e-4, atol=1e-4 * weight)
    assert state.vertex_contact_force.sum() == pytest.approx(weight, rel=1e-3)
    assert report.contacts == 12 == len(state.contact_key) and report.contact_gap < 1e-6
    assert (np.diff(state.contact_key) > 0).all()
    np.testing.assert_allclose(state.x[:, 2], RADIUS, rtol=1e-5)


def test_a_step_goes_on_from_its_state_alone():
    model, state, _ = at_rest(5)
    one, other = state.copy(), state.copy()
    stepper = StrandStepper(model, DOWN)
    for _ in range(4):
        stepper.step(one, H, obstacles=floor())
        StrandStepper(model, DOWN).step(other, H, obstacles=floor())
    for name, values in vars(one).items():
        np.testing.assert_array_equal(values, getattr(other, name))


def test_the_handle_side_of_a_contact_pushes():
    """A strand that is given its way takes a free one with it."""
    model, state = two_that_hit(0.0)
    model.held[16:] = True
    stepper = StrandStepper(model, ZERO)
    for _ in range(10):
        given_ = state.x - np.array([0.0, 0.0, 2e-4]), np.zeros(32)
        report = stepper.step(state, H, given=given_)
        assert report.accepted, report.reason
    assert report.contacts > 0 or state.velocity[:16, 2].mean() < -0.05
    assert state.x[:16, 2].min() < -5e-4
    assert not crossed(state.x, 0 * state.x, np.arange(15), np.arange(16, 31))


TWICE = "a place near a vertex is a contact of both edges, each with the whole pull: 1.02 to 2 of it are held"


@pytest.mark.parametrize(("at", "pull", "parts"), [
    (0.25, 0.98, False), (0.25, 1.02, True),
    (0.0, 0.98, False), pytest.param(0.0, 1.02, True, marks=pytest.mark.xfail(strict=True, reason=TWICE)),
])
def test_cohesion_holds_a_crossing_up_to_its_force(at, pull, parts):
    """What crosses amid an edge, at a share of an edge of its own, holds what cohesion is on the thickness."""
    settings = StrandSettings(cohesion=0.01, cohesion_reach=0.2 * RADIUS)
    model, state = two_that_hit(0.0, vertices=3)
    model.held[:3] = True
    state.x[3:] += [0.009, -0.02 * at, 2 * RADIUS - 1e-3]
    force = np.zeros_like(state.x)
    force[4, 2], force[5, 2] = pull * settings.cohesion * 2 * RADIUS * np.array([1.0 - at, at])
    stepper = StrandStepper(model, ZERO, settings)
    for _ in range(40):
        report = stepper.step(state, H, StrandLoads(force=force))
        assert report.accepted, report.reason
    height = (1.0 - at) * state.x[4, 2] + at * state.x[5, 2]
    assert (height > 2 * RADIUS + settings.cohesion_reach) == parts


def test_strands_in_one_place_part_slowly_and_break_nothing():
    """Nothing says where either lies, so that any direction across them is as good as another."""
    assembly, along = StrandAssembly(), np.linspace(0.0, 0.02, 6)
    for _ in range(2):
        assembly.strand(np.column_stack([along, 0 * along, 0 * along]), 5e-5, HAIR, friction=0.3)
    model, state = assembly.build()
    stepper = StrandStepper(model, np.array([0.0, 0.0, -9.81]))
    apart = [0.0]
    for _ in range(5):
        assert stepper.step(state, 1e-3).accepted
        apart.append(np.linalg.norm(state.x[:6] - state.x[6:], axis=1).max())
    assert np.isfinite(state.x).all() and len(stepper.contacts.edge) > 0
    assert np.all(np.diff(apart) > 0.0) and np.diff(apart).max() <= 1.1 * MOST * 1e-4 * 1e-3 / MENDING


def test_what_is_squeezed_between_two_walls_stays_as_deep_in_both():
    apart = 1.9 * RADIUS
    up, down = np.eye(3), np.diag([1.0, -1.0, -1.0])
    walls = Obstacles(np.full(2, ObstacleKind.PLANE), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, apart]]), np.stack([up, down]),
                      np.zeros((2, 3)), np.array([0.3, 0.3]))
    between = motion(walls, no_handles(), 0.0, H)
    s, assembly = np.linspace(-0.02, 0.02, 5), StrandAssembly()
    assembly.strand(np.column_stack([s, 0 * s, np.full(5, 0.5 * apart)]), RADIUS, HAIR)
    model, state = assembly.build()
    stepper = StrandStepper(model, ZERO)
    for _ in range(5):
        report = stepper.step(state, H, obstacles=between)
        assert report.accepted, report.reason
        assert report.contact_gap <= 0.05 + 1e-2
