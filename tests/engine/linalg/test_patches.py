"""Patches: each of one body and within one cube, never too many, with affine modes and the neighbours that blocks give them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.linalg.block_matrix import with_pattern
from engine.linalg.patches import form_patches
from tests.engine.linalg.dense import grid

EDGE = 0.5
AMPLE = 10**6  # patches: no limit


def cloud(seed, rows, bodies):
    """Places of rows in a box, and the bodies of each: one that all have, of some a second."""
    rng = np.random.default_rng(seed)
    first = rng.integers(0, bodies, rows)
    first[:bodies] = np.arange(bodies)
    second = np.where(rng.random(rows) < 0.3, rng.integers(0, bodies, rows), -1)
    return rng.uniform(-1.0, 1.0, (rows, 3)), np.column_stack([first, np.where(second == first, -1, second)])


def patches_of(place, bodies, edge=EDGE, most=AMPLE, pairs=()):
    a, _ = with_pattern(len(place), np.array(pairs, np.int64).reshape(-1, 2))
    return form_patches(place, bodies, edge, most, a.start, a.column), a


CLOUDS = given(seed=st.integers(0, 1000), rows=st.integers(4, 40), bodies=st.integers(1, 4))


@settings(deadline=None)
@CLOUDS
def test_rows_share_a_patch_where_they_share_body_and_cube(seed, rows, bodies):
    place, body = cloud(seed, rows, bodies)
    patches, _ = patches_of(place, body)
    cube = np.floor((place - place.min(axis=0)) / EDGE)
    wanted = {}  # patch of every body and cube
    for row, slot in np.ndindex(body.shape):
        if body[row, slot] >= 0:
            assert wanted.setdefault((body[row, slot], *cube[row]), patches.of[row, slot]) == patches.of[row, slot]
        else:
            assert patches.of[row, slot] == -1
    assert sorted(wanted.values()) == list(range(patches.count))


@settings(deadline=None)
@CLOUDS
def test_members_are_all_rows_of_all_bodies_by_their_patches(seed, rows, bodies):
    place, body = cloud(seed, rows, bodies)
    patches, _ = patches_of(place, body)
    of_member = np.repeat(np.arange(patches.count), np.diff(patches.start))
    np.testing.assert_array_equal(patches.of.ravel()[patches.members], of_member)
    np.testing.assert_array_equal(np.sort(patches.members), np.flatnonzero(body.ravel() >= 0))


@settings(deadline=None)
@given(seed=st.integers(0, 1000), rows=st.integers(4, 40), bodies=st.integers(1, 4), spare=st.integers(0, 20))
def test_never_more_patches_than_the_most_and_none_of_two_bodies(seed, rows, bodies, spare):
    place, body = cloud(seed, rows, bodies)
    patches, _ = patches_of(place, body, edge=0.01, most=bodies + spare)
    assert bodies <= patches.count <= bodies + spare
    for p in range(patches.count):
        assert len(set(body.ravel()[patches.members[patches.start[p] : patches.start[p + 1]]])) == 1


def test_more_bodies_than_the_most_have_a_patch_for_each_cube_at_least():
    place, body = cloud(0, 20, 4)
    assert patches_of(place, body, most=2)[0].count >= 4  # as patches never mix bodies, and it ends


@settings(deadline=None)
@CLOUDS
def test_modes_are_one_and_the_places_along_the_two_longest_directions(seed, rows, bodies):
    place, body = cloud(seed, rows, bodies)
    patches, _ = patches_of(place, body)
    mode = patches.mode.reshape(-1, 3)
    np.testing.assert_array_equal(mode[:, 0], 1.0)
    for p in range(patches.count):
        members = patches.members[patches.start[p] : patches.start[p + 1]]
        away = (place[members // 2] - place[members // 2].mean(axis=0)) / EDGE
        linear = mode[members, 1:]
        np.testing.assert_allclose(linear.sum(axis=0), 0.0, atol=1e-10)
        direction = np.linalg.lstsq(away, linear, rcond=1e-9)[0]
        np.testing.assert_allclose(away @ direction, linear, atol=1e-8)
        longest = np.linalg.eigvalsh(away.T @ away)[:0:-1]
        np.testing.assert_allclose(linear.T @ linear, np.diag(longest), atol=1e-9)


def test_a_row_of_two_bodies_has_a_mode_value_for_each():
    place = np.array([[0.0, 0, 0], [0.2, 0, 0], [0.4, 0, 0]])
    patches, _ = patches_of(place, np.array([[0, -1], [0, 1], [1, -1]]))
    np.testing.assert_allclose(np.abs(patches.mode[:, 0, 1]), 0.1 / EDGE)
    assert patches.mode[1, 0, 1] == pytest.approx(-patches.mode[0, 0, 1])  # about the middle of body 0
    assert patches.mode[1, 1, 1] == pytest.approx(-patches.mode[2, 0, 1])  # about that of body 1


def neighbours(patches):
    return [patches.column[a:b].tolist() for a, b in zip(patches.first[:-1], patches.first[1:], strict=True)]


@settings(deadline=None)
@given(seed=st.integers(0, 1000), bodies=st.integers(1, 3))
def test_neighbours_are_the_patches_that_share_a_block(seed, bodies):
    place, body = cloud(seed, 24, bodies)
    patches, a = patches_of(place, body, pairs=grid(4, 6))
    wanted = [set() for _ in range(patches.count)]
    for i in range(a.rows):
        for j in a.column[a.start[i] : a.start[i + 1]]:
            for p in patches.of[i][patches.of[i] >= 0]:
                wanted[p] |= set(patches.of[j][patches.of[j] >= 0].tolist())
    assert neighbours(patches) == [sorted(found) for found in wanted]


def test_a_patch_may_have_any_number_of_neighbours():
    everything = [(i, j) for i in range(150) for j in range(i)]
    place, body = np.arange(150.0)[:, None] * [1.0, 0.0, 0.0], np.column_stack([np.zeros(150, np.int64), np.full(150, -1)])
    patches, _ = patches_of(place, body, pairs=everything)
    assert neighbours(patches) == [list(range(150))] * 150
