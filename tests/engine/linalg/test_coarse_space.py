"""The coarse correction against its dense formula, and what it is for: stiff cloth in few iterations, of any size."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg import coarse_space
from engine.linalg.block_matrix import BLOCK, BlockMatrix, with_pattern
from engine.linalg.coarse_space import FLAT, RIDGE, SIZE, CoarseSpace, TwoLevels
from engine.linalg.conjugate_gradient import conjugate_gradient
from tests.engine.linalg.dense import Identity, blocked, dense, factors, grid, positive
from tests.engine.threads import on_one_and_two_threads

ROWS, GRID = 24, grid(4, 6)
FOLLOWS = np.vstack([np.eye(3), np.zeros((2, 3))])  # x moves with its body, u does not


def system(seed, bodies, edge=0.8, full=None):
    """A coarse space over a random matrix, or the given one, whose rows are of one or two bodies and follow them anyhow."""
    rng = np.random.default_rng(seed)
    a, _ = blocked(positive(rng, ROWS, GRID) if full is None else full, GRID)
    first = rng.integers(0, bodies, ROWS)
    second = np.where(rng.random(ROWS) < 0.3, (first + 1) % bodies, -1)
    body = np.column_stack([first, np.where(second == first, -1, second)])
    body[:bodies, 0], body[:bodies, 1] = np.arange(bodies), -1
    response = rng.normal(size=(ROWS, 2, BLOCK, 3)).astype(np.float32)
    return CoarseSpace(a, rng.uniform(-1.0, 1.0, (ROWS, 3)), body, response, edge), rng.normal(size=(ROWS, BLOCK))


def prolongation(coarse):
    """P in full, shape [5 n, 9 p]."""
    patches = coarse.patches
    p = np.zeros((len(patches.of), BLOCK, patches.count, SIZE))
    for row, slot in np.ndindex(patches.of.shape):
        if patches.of[row, slot] >= 0:
            p[row, :, patches.of[row, slot]] += np.kron(patches.mode[row, slot], coarse.response[row, slot].astype(float))
    return p.reshape(len(patches.of) * BLOCK, -1)


def reference_correction(coarse, b):
    """P (P^T A P)^-1 P^T b over the modes that there are, with the ridge."""
    p = prolongation(coarse)
    reduced = p.T @ dense(coarse.matrix) @ p
    there = np.diagonal(reduced) > FLAT * np.diagonal(reduced).max()
    p, reduced = p[:, there], reduced[np.ix_(there, there)]
    return (p @ np.linalg.solve(reduced + RIDGE * np.diag(np.diagonal(reduced)), p.T @ b.ravel())).reshape(b.shape)


def correction(coarse, b):
    out = np.zeros_like(b)
    coarse.add_correction(b, out)
    return out


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 1000), bodies=st.integers(1, 3), edge=st.sampled_from([0.3, 0.8, 3.0]))
def test_the_correction_is_that_of_the_formula(seed, bodies, edge):
    coarse, b = system(seed, bodies, edge)
    assert coarse.refresh()
    wanted = reference_correction(coarse, b)
    np.testing.assert_allclose(correction(coarse, b), wanted, rtol=0.0, atol=1e-7 * np.abs(wanted).max())


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000), bodies=st.integers(1, 3))
def test_what_the_coarse_space_can_express_is_solved(seed, bodies):
    coarse, _ = system(seed, bodies, edge=3.0)  # one patch per body: their modes do not depend on each other
    assert coarse.refresh()
    p = prolongation(coarse)
    x = p @ np.random.default_rng(seed).normal(size=p.shape[1])
    found = correction(coarse, (dense(coarse.matrix) @ x).reshape(-1, BLOCK))
    assert np.linalg.norm(found.ravel() - x) <= 1e-2 * np.linalg.norm(x)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 1000), bodies=st.integers(1, 3))
def test_symmetric_and_positive_with_local_factors(seed, bodies):
    coarse, b = system(seed, bodies)
    assert coarse.refresh()
    both = TwoLevels(factors(coarse.matrix), coarse)
    c = np.random.default_rng(seed + 1).normal(size=b.shape)
    of_b, of_c = np.full_like(b, np.nan), np.full_like(c, np.nan)
    both.solve(b, of_b)
    both.solve(c, of_c)
    assert np.sum(of_b * b) > 0.0
    assert np.sum(of_b * c) == pytest.approx(np.sum(b * of_c), rel=1e-7, abs=1e-7)


def test_two_levels_add_what_both_do():
    coarse, b = system(0, 2)
    coarse.refresh()
    local, out, alone = factors(coarse.matrix), np.empty_like(b), np.empty_like(b)
    TwoLevels(local, coarse).solve(b, out)
    local.solve(b, alone)
    np.testing.assert_allclose(out, alone + correction(coarse, b), rtol=1e-12, atol=1e-12)


def test_values_that_changed_count_from_the_next_refresh_on():
    coarse, b = system(0, 2)
    coarse.refresh()
    before = correction(coarse, b)
    coarse.matrix.block *= 4.0
    np.testing.assert_array_equal(correction(coarse, b), before)
    coarse.refresh()
    np.testing.assert_allclose(correction(coarse, b), 0.25 * before, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("held", [[0], [3, 7, 8], range(ROWS - 1)], ids=["one", "some", "all but one"])
def test_what_is_held_is_never_moved(held):
    coarse, b = system(1, 2)
    coarse.response[list(held)] = 0.0
    assert coarse.refresh()
    moved = correction(coarse, b)
    assert not moved[list(held)].any() and np.delete(moved, list(held), axis=0).all()


def test_places_on_a_line_have_modes_that_do_not_exist():
    coarse, b = system(2, 1)
    on_line = np.linspace(0.0, 2.0, ROWS)[:, None] * [[0.6, 0.8, 0.0]]
    coarse = CoarseSpace(coarse.matrix, on_line, np.tile([0, -1], (ROWS, 1)), coarse.response, 0.5)
    assert coarse.refresh()
    wanted = reference_correction(coarse, b)
    np.testing.assert_allclose(correction(coarse, b), wanted, rtol=0.0, atol=1e-7 * np.abs(wanted).max())


def single_patches(full):
    """A coarse space in which every row is a patch of its own."""
    a, _ = blocked(full, GRID)
    place = np.arange(ROWS)[:, None] * np.array([1.0, 0.0, 0.0])
    response = np.tile(FOLLOWS.astype(np.float32), (ROWS, 2, 1, 1))
    coarse = CoarseSpace(a, place, np.tile([0, -1], (ROWS, 1)), response, 0.5)
    assert coarse.patches.count == ROWS
    return coarse


def is_solved(coarse):
    """Whether the coarse matrix has factors, and conjugate gradients then find no direction that curves downwards."""
    b, x = np.random.default_rng(0).normal(size=(ROWS, BLOCK)), np.empty((ROWS, BLOCK))
    return coarse.refresh() and conjugate_gradient(coarse.matrix, b, x, TwoLevels(Identity(), coarse), 1e-9, 100).positive


@pytest.mark.parametrize(("across", "positive"), [(0.9, True), (1.1, False), (-0.9, True), (-1.1, False)])
def test_a_matrix_that_two_patches_make_indefinite_is_found_out(across, positive):
    full = np.eye(ROWS * BLOCK)
    full[0, BLOCK] = full[BLOCK, 0] = across
    assert is_solved(single_patches(full)) == positive


@pytest.mark.parametrize("negative", [1, 7, 3 * BLOCK], ids=lambda n: f"{n} unknowns")
def test_a_matrix_that_curves_downwards_along_a_patch_is_found_out(negative):
    full = np.eye(ROWS * BLOCK)
    full[:negative] *= -1.0
    assert not is_solved(single_patches(full))


def test_the_size_of_the_coarse_system_is_bounded(monkeypatch):
    monkeypatch.setattr(coarse_space, "MOST_PATCHES", 5)
    assert 2 <= system(0, 2, edge=0.01)[0].patches.count <= 5


def sheet(wide: int, long: int, dtype=np.float64) -> tuple[BlockMatrix, np.ndarray, np.ndarray]:
    """A sheet of springs in x, so stiff that a pull runs over 100 of them, with u free; places, and a pull at its end."""
    pairs = np.array(grid(wide, long))
    a, number = with_pattern(wide * long, pairs, dtype)
    row = np.repeat(np.arange(a.rows), np.diff(a.start))
    moves = np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
    a.block[:] = -moves
    a.block[a.diagonal] = (np.bincount(row)[:, None, None] - 1 + 1e-4) * moves + np.diag([0.0, 0.0, 0.0, 1.0, 1.0])
    place, pull = np.zeros((a.rows, 3)), np.zeros((a.rows, BLOCK))
    at = np.arange(a.rows)
    place[number, 0], place[number, 1] = at // wide, at % wide
    pull[number[-wide:], 0] = 1.0
    return a, place, pull


def iterations_of(a, place, pull):
    """How many conjugate gradients take with factors alone, and with a coarse space as well."""
    response = np.tile(FOLLOWS.astype(np.float32), (a.rows, 2, 1, 1))
    coarse = CoarseSpace(a, place, np.tile([0, -1], (a.rows, 1)), response, 6.0)
    assert coarse.refresh()
    counts, x = [], np.empty_like(pull)
    for preconditioner in (local := factors(a), TwoLevels(local, coarse)):
        iterations, positive, sound, _ = conjugate_gradient(a, pull, x, preconditioner, 1e-6, 1000, outlier=8.0)
        assert positive and sound
        counts.append(iterations)
    return counts


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_stiff_sheet_takes_few_iterations_that_do_not_grow_with_its_size(dtype):
    alone, together = np.transpose([iterations_of(*sheet(12, long, dtype)) for long in (60, 120, 240)])
    assert (3 * together < alone).all()
    assert together.max() <= together.min() + 3


def test_the_same_to_the_bit_on_any_number_of_threads():
    a, place, _ = sheet(12, 60)
    rng = np.random.default_rng(0)
    response, b = rng.normal(size=(a.rows, 2, BLOCK, 3)).astype(np.float32), rng.normal(size=(a.rows, BLOCK))
    body = np.column_stack([place[:, 0] > 30.0, np.where(place[:, 1] > 9.0, place[:, 0] <= 30.0, -1)]).astype(np.int64)

    def corrected():
        coarse = CoarseSpace(a, place, body, response, 4.0)
        coarse.refresh()
        return correction(coarse, b).tobytes()

    one, two = on_one_and_two_threads(corrected)
    assert one == two
