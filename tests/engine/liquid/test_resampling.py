"""Particles join, split and move apart: all that must stay does, and who joins whom is what the slow way says."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.liquid.model import LiquidModel, LiquidState
from engine.liquid.resampling import LARGE, MOST, SMALL, STIFFNESS, merge, relax, split
from tests.engine.threads import on_one_and_two_threads

SPACING = 0.01
FINE = SPACING**3 / 8
CHANGES = {
    "merge": merge, "split": split,
    "relax": lambda model, state, fine_volume, clear: relax(model, state, clear),
}


def liquid(period=(0, 0, 0)):
    return LiquidModel(
        density=1000.0, bulk_modulus=1e5, shear_modulus=10.0, yield_stress=1.0, consistency=1.0, flow_index=0.5,
        surface_tension=0.0, tearing_strain=np.inf, recovery_rate=0.0, spacing=SPACING, origin=np.zeros(3),
        period=np.array(period), no_slip=False, low=np.full(3, -1.0), high=np.full(3, 1.0),
    )


def particles(rng, count, cells=3.0, sizes=(0.1, 5.0), kept=True):
    """Particles at random in a cube of some cells, of sizes in fine volumes, with all that they may carry."""
    root = np.eye(3) + 0.15 * rng.normal(size=(count, 3, 3))
    b = root @ root.transpose(0, 2, 1)
    b /= np.cbrt(np.linalg.det(b))[:, None, None]
    return LiquidState(
        x=cells * SPACING * rng.random((count, 3)), velocity=rng.normal(size=(count, 3)),
        affine=10.0 * rng.normal(size=(count, 3, 3)),
        volume=FINE * np.exp(rng.uniform(*np.log(sizes), count)),
        strain=b[:, (0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)] if kept else None,
        compression=rng.uniform(0.5, 2.0, count) if kept else None, plastic_strain=rng.random(count) if kept else None,
        emitted=np.array([3]), drained=np.array([0.1]),
    )


def everywhere(x):
    return np.ones(len(x), bool)


def left(x):
    """Whether clear of a solid to the right."""
    return x[:, 0] < 1.5 * SPACING


def spins(affine):
    turning = affine - affine.transpose(0, 2, 1)
    return np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)


def angular_momenta(state):
    """Angular momentum by density of each particle about the middle of the cube, and by what size round-off is judged."""
    orbit = np.cross(state.x - 1.5 * SPACING, state.velocity)
    spin = 0.25 * SPACING**2 * spins(state.affine)
    return state.volume[:, None] * (orbit + spin), state.volume @ (np.abs(orbit) + np.abs(spin)).max(axis=1)


def totals(state):
    """What all changes keep, each with its size."""
    volume = state.volume
    size = volume.sum()
    angular, angular_size = angular_momenta(state)
    kept = [(size, size), (volume @ state.x, size * SPACING), (volume @ state.velocity, size)]
    kept.append((angular.sum(axis=0), angular_size))
    if state.compression is not None:
        kept += [(volume @ state.compression, size), (volume @ state.plastic_strain, size)]
    return kept


def assert_kept(before, after):
    for (old, size), (new, _) in zip(totals(before), totals(after), strict=True):
        assert np.abs(new - old).max() <= 1e-12 * size


def arrays(state):
    return {field.name: getattr(state, field.name) for field in fields(state)}


def in_order(state):
    order = np.lexsort(np.round(state.x.T / SPACING, 6))
    return {name: array[order] for name, array in arrays(state).items() if name not in ("emitted", "drained")}


def permuted(state, order):
    return replace(state, **{name: array[order] for name, array in arrays(state).items() if name not in ("emitted", "drained")})


seeds = st.integers(0, 2**32 - 1)


def test_the_spin_of_a_particle_is_what_it_gives_to_a_staggered_grid():
    rng = np.random.default_rng(0)
    state = particles(rng, 1)
    x, total = state.x[0] / SPACING, np.zeros(3)
    for a in range(3):
        for node in np.ndindex(6, 6, 6):
            face = np.array(node) - 1.0 + 0.5 * (np.arange(3) != a)
            d = np.abs(x - face)
            weight = np.prod(np.where(d < 0.5, 0.75 - d**2, np.where(d < 1.5, 0.5 * (1.5 - d) ** 2, 0.0)))
            speed = state.velocity[0, a] + state.affine[0, a] @ (face - x) * SPACING
            total += state.volume[0] * weight * speed * np.cross(face * SPACING - 1.5 * SPACING, np.eye(3)[a])
    np.testing.assert_allclose(total, angular_momenta(state)[0][0], rtol=1e-10)


@pytest.mark.parametrize("change", CHANGES)
@settings(deadline=None, max_examples=40)
@given(seeds, st.integers(0, 150), st.booleans(), st.booleans())
def test_what_must_stay_stays(change, seed, count, kept, solid):
    before = particles(np.random.default_rng(seed), count, kept=kept)
    original = {name: None if array is None else array.copy() for name, array in arrays(before).items()}
    after = CHANGES[change](liquid(), before, FINE, left if solid else everywhere)
    assert_kept(before, after)
    assert (after.volume > 0.0).all()
    if kept:
        b = after.strain[:, [0, 5, 4, 5, 1, 3, 4, 3, 2]].reshape(-1, 3, 3)
        np.testing.assert_allclose(np.linalg.det(b), 1.0, rtol=1e-12)
        assert (np.linalg.eigvalsh(b) > 0.0).all() and (after.compression > 0.0).all()
    else:
        assert after.strain is after.compression is after.plastic_strain is None
    for name, array in arrays(before).items():
        np.testing.assert_array_equal(array, original[name])  # nobody writes into what was given
    if solid:
        near = ~left(before.x)
        for name in ("x", "volume", "velocity"):
            now = {row.tobytes() for row in getattr(after, name)}
            assert {row.tobytes() for row in getattr(before, name)[near]} <= now


@pytest.mark.parametrize("change", CHANGES)
@settings(deadline=None, max_examples=20)
@given(seeds, st.integers(2, 100))
def test_the_order_of_particles_does_not_matter(change, seed, count):
    rng = np.random.default_rng(seed)
    state, order = particles(rng, count, sizes=(0.1, 3.0)), rng.permutation(count)
    one = in_order(CHANGES[change](liquid(), state, FINE, everywhere))
    other = in_order(CHANGES[change](liquid(), permuted(state, order), FINE, everywhere))
    for name, array in one.items():
        np.testing.assert_allclose(array, other[name], rtol=1e-9, atol=1e-9 * np.abs(array).max())


@pytest.mark.parametrize("change", CHANGES)
@settings(deadline=None, max_examples=20)
@given(seeds, st.tuples(*[st.integers(-3, 3)] * 3))
def test_space_that_repeats_has_no_edge(change, seed, turns):
    """Particles of a periodic cube, carried round by whole cells, do the same as they did."""
    rng = np.random.default_rng(seed)
    state = particles(rng, 200, cells=4.0, sizes=(0.1, 1.9))
    length = 4 * SPACING
    shift = SPACING * np.array(turns)
    moved = replace(state, x=(state.x + shift) % length)
    one, other = (CHANGES[change](liquid((4, 4, 4)), s, FINE, everywhere) for s in (state, moved))
    away = other.x - shift - one.x
    np.testing.assert_allclose(away, length * np.round(away / length), atol=1e-9 * length)
    for name in ("velocity", "affine", "volume"):
        wanted = getattr(one, name)
        np.testing.assert_allclose(getattr(other, name), wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("change", CHANGES)
def test_any_number_of_threads_does_the_same(change):
    state = particles(np.random.default_rng(4), 5000, cells=8.0, sizes=(0.2, 3.0))
    one, two = on_one_and_two_threads(lambda: CHANGES[change](liquid(), state, FINE, everywhere))
    for name, array in arrays(one).items():
        np.testing.assert_array_equal(array, getattr(two, name))


@pytest.mark.parametrize("change", [merge, split])
def test_particles_of_a_good_size_are_left_alone_without_a_look(change):
    def never(x):
        raise AssertionError("no solid need be asked")

    state = particles(np.random.default_rng(0), 50, sizes=(SMALL, LARGE))
    assert change(liquid(), state, FINE, never) is state


def joining(state, clear):
    """Pairs that join, one by one: each the nearest that the other may join."""
    reach, count, ways = 2.0 * (0.75 * FINE / np.pi) ** (1 / 3), len(state.x), {}
    free = clear(state.x)
    for i in range(count):
        for j in range(count):
            small = min(state.volume[i], state.volume[j]) < SMALL * FINE
            distance = np.linalg.norm(state.x[i] - state.x[j])
            fit = small and distance <= reach and state.volume[i] + state.volume[j] <= LARGE * FINE
            if i != j and fit and free[i] and free[j]:
                ways.setdefault(i, []).append((distance, j))
    nearest = {i: min(found)[1] for i, found in ways.items()}
    return [(i, j) for i, j in nearest.items() if i < j and nearest[j] == i]


@settings(deadline=None, max_examples=40)
@given(seeds, st.integers(2, 80))
def test_who_joins_is_each_the_others_nearest(seed, count):
    before = particles(np.random.default_rng(seed), count, sizes=(0.1, 2.5))
    after = merge(liquid(), before, FINE, left)
    pairs = joining(before, left)
    assert len(after.x) == count - len(pairs)
    gone = {j for _, j in pairs}
    others = [i for i in range(count) if i not in gone]
    joint = dict(pairs)
    for new, i in enumerate(others):
        members = [i, joint[i]] if i in joint else [i]
        weights = before.volume[members] / before.volume[members].sum()
        assert after.volume[new] == before.volume[members].sum()
        for name in ("x", "velocity", "compression", "plastic_strain"):
            mean = weights @ getattr(before, name)[members]
            np.testing.assert_allclose(getattr(after, name)[new], mean, rtol=1e-12, atol=1e-15)
        rate = after.affine[new] + after.affine[new].T
        wanted = np.einsum("p,pij->ij", weights, before.affine[members])
        np.testing.assert_allclose(rate, wanted + wanted.T, atol=1e-11)


def test_equal_distances_go_to_the_lower_particle():
    state = particles(np.random.default_rng(0), 3, sizes=(0.2, 0.3))
    state.x[:] = SPACING * np.array([[1.0, 1.0, 1.0], [1.25, 1.0, 1.0], [0.75, 1.0, 1.0]])
    after = merge(liquid(), state, FINE, everywhere)
    assert len(after.x) == 2
    np.testing.assert_array_equal(after.x[1], state.x[2])


def test_after_some_calls_only_lone_ones_are_small():
    state = particles(np.random.default_rng(0), 1500, cells=4.0, sizes=(0.05, 0.4))
    for _ in range(20):
        state = merge(liquid(), state, FINE, everywhere)
    assert merge(liquid(), state, FINE, everywhere) is state and joining(state, everywhere) == []
    assert len(state.x) < 400 and np.mean(state.volume < SMALL * FINE) < 0.05


@settings(deadline=None, max_examples=40)
@given(seeds, st.integers(1, 20), st.floats(0.1, 100.0))
def test_parts_are_not_large_and_near_where_the_whole_was(seed, count, size):
    before = particles(np.random.default_rng(seed), count, sizes=(size, 1.5 * size))
    after = split(liquid(), before, FINE, everywhere)
    assert (after.volume <= LARGE * FINE).all()
    assert (after.volume >= np.minimum(FINE, before.volume.min())).all()
    distance = np.linalg.norm(after.x[:, None] - before.x[None], axis=2).min(axis=1)
    assert (distance <= 0.5 * SPACING * np.ceil(np.log2(max(before.volume.max() / (LARGE * FINE), 1.0)))).all()


def test_halves_fill_all_directions_evenly():
    before = particles(np.random.default_rng(0), 4000, sizes=(2.5, 2.6))
    after = split(liquid(), before, FINE, everywhere)
    way = after.x[:4000] - before.x
    way /= np.linalg.norm(way, axis=1)[:, None]
    np.testing.assert_allclose(way.T @ way / 4000, np.eye(3) / 3, atol=0.02)
    np.testing.assert_allclose(way.mean(axis=0), 0.0, atol=0.04)


@pytest.mark.parametrize("change", ["split", "relax"])
def test_a_linear_field_of_velocity_stays_what_it_is(change):
    rng = np.random.default_rng(2)
    gradient = 10.0 * rng.normal(size=(3, 3))
    before = particles(rng, 300, sizes=(0.5, 3.9))  # no more than one split, which leaves the rest the gradient
    before.affine[:] = gradient
    before.velocity[:] = before.x @ gradient.T
    after = CHANGES[change](liquid(), before, FINE, everywhere)
    assert not np.array_equal(after.x, before.x)
    np.testing.assert_allclose(after.velocity, after.x @ gradient.T, rtol=0, atol=1e-13)
    rate = np.broadcast_to(gradient + gradient.T, after.affine.shape)
    np.testing.assert_allclose(after.affine + after.affine.transpose(0, 2, 1), rate, atol=1e-12)


def test_pairs_move_apart_as_they_do_one_by_one():
    before = particles(np.random.default_rng(3), 120, cells=2.0)
    after = relax(liquid(), before, left)
    free, edge, volume = np.flatnonzero(left(before.x)), np.cbrt(before.volume), before.volume
    push = np.zeros((120, 120, 3))
    for i in free:
        for j in free:
            r = before.x[i] - before.x[j]
            overlap = 0.5 * (edge[i] + edge[j]) - np.linalg.norm(r)
            if i != j and overlap > 0.0:
                push[i, j] = STIFFNESS * overlap * volume[i] * volume[j] / (volume[i] + volume[j]) * r / np.linalg.norm(r)
    share = np.minimum(1.0, MOST * SPACING * volume / np.maximum(np.linalg.norm(push, axis=2).sum(axis=1), 1e-300))
    push *= np.minimum(share[:, None], share[None])[:, :, None]
    np.testing.assert_allclose(after.x, before.x + push.sum(axis=1) / volume[:, None], rtol=1e-12)
    assert (share < 1.0).any() and (share[free] == 1.0).any()


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(2, 200))
def test_nothing_moves_further_than_a_tenth_of_a_cell(seed, count):
    before = particles(np.random.default_rng(seed), count, cells=1.0)
    after = relax(liquid(), before, everywhere)
    assert np.linalg.norm(after.x - before.x, axis=1).max() <= MOST * SPACING * (1.0 + 1e-12)


def test_two_that_are_too_near_come_as_far_apart_as_is_even():
    state = particles(np.random.default_rng(0), 2, sizes=(0.7, 1.5))
    state.x[1] = state.x[0] + 0.1 * SPACING
    for _ in range(150):
        state = relax(liquid(), state, everywhere)
    np.testing.assert_allclose(np.linalg.norm(state.x[0] - state.x[1]), np.cbrt(state.volume).mean(), rtol=1e-9)


def test_a_crowd_becomes_even():
    rng = np.random.default_rng(0)
    state = particles(rng, 8 * 8**3, cells=8.0, sizes=(1.0, 1.0 + 1e-9))

    def spread(state):
        cells = np.floor(state.x / SPACING).astype(int) % 8
        return np.bincount(np.ravel_multi_index(tuple(cells.T), (8, 8, 8)), minlength=512).std()

    at_first = spread(state)
    for _ in range(20):
        state = relax(liquid((8, 8, 8)), state, everywhere)
    assert spread(state) < 0.72 * at_first


def test_those_at_one_place_or_alone_stay():
    state = particles(np.random.default_rng(0), 4)
    for places in (np.zeros((4, 3)), SPACING * np.arange(0.0, 36.0, 3.0).reshape(4, 3)):
        placed = replace(state, x=places)
        assert relax(liquid(), placed, everywhere) is placed
