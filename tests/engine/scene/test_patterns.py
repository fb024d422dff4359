"""Weave patterns by what a weaver would count."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.scene.build import build
from engine.scene.load import load_scene
from engine.scene.patterns import PATTERNS, PatternName, satin, twill, warp_over
from tests.engine.scene.scenes import cloth, scene_of

# longest run over (warps over wefts, wefts over warps) in one repeat laid side by side
FLOATS = {"plain": (1, 1), "twill-2/1": (2, 1), "twill-3/1": (3, 1), "denim": (3, 1), "twill-2/2": (2, 2),
          "satin-5": (4, 1), "satin-8": (7, 1), "basket-2/2": (2, 2)}
REPEATS = st.integers(1, 7).flatmap(lambda n: st.lists(st.lists(st.integers(0, 1), min_size=n, max_size=n), min_size=1,
                                                       max_size=7))


def longest_run(flags):
    """Longest run of true entries in the rows of `flags`."""
    text = "\n".join("".join("x" if flag else " " for flag in row) for row in flags)
    return max(map(len, text.split()), default=0)


def test_every_name_has_a_pattern():
    assert tuple(PATTERNS) == get_args(PatternName) and set(FLOATS) == set(PATTERNS)


@pytest.mark.parametrize("name", FLOATS)
def test_floats_are_as_long_as_the_name_says(name):
    over = np.tile(PATTERNS[name], (4, 4))
    assert (longest_run(over.T), longest_run(~over)) == FLOATS[name]


@pytest.mark.parametrize("name", FLOATS)
def test_every_yarn_is_bound(name):
    over = PATTERNS[name]
    for axis in (0, 1):
        assert over.any(axis=axis).all() and not over.all(axis=axis).any()


@given(over=st.integers(1, 20), under=st.integers(1, 20))
def test_twills_rise_to_the_right(over, under):
    pattern = twill(over, under)
    np.testing.assert_array_equal(np.roll(pattern, (1, 1), axis=(0, 1)), pattern)
    assert (pattern.sum(axis=0) == over).all() and (pattern.sum(axis=1) == over).all()


@given(st.tuples(st.integers(5, 40), st.integers(2, 39)).filter(lambda satin: np.gcd(*satin) == 1))
def test_satins_have_one_interlacing_in_every_row_and_column(size):
    under = ~satin(*size)
    assert (under.sum(axis=0) == 1).all() and (under.sum(axis=1) == 1).all()


@given(REPEATS, st.integers(0, 10**6), st.integers(0, 10**6))
def test_repeats_tile(rows, warp, weft):
    repeat = np.array(rows, np.bool_)
    i, j = np.array([warp, warp + repeat.shape[1], warp]), np.array([weft, weft, weft + repeat.shape[0]])
    assert len(set(warp_over(repeat, i, j).tolist())) == 1
    assert warp_over(repeat, i, j)[0] == rows[weft % len(rows)][warp % len(rows[0])]


@pytest.mark.parametrize("pattern", ["satin-5", [[1, 0, 0], [0, 1, 1]]])
def test_a_patch_is_woven_as_its_pattern_says(pattern):
    warps, wefts = 7, 6
    model = build(load_scene(scene_of(fabrics=[cloth(warps=warps, wefts=wefts, pattern=pattern)]))).yarns
    repeat = PATTERNS[pattern] if isinstance(pattern, str) else np.array(pattern)
    for i in range(warps):
        nodes = np.arange(model.node_start[i], model.node_start[i + 1])[1:-1]
        rows, columns = repeat.shape
        assert model.node_slot[nodes].tolist() == [int(repeat[j % rows, i % columns]) for j in range(wefts)]
