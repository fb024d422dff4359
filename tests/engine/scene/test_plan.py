"""Crossings of straight lines against the plain double loop."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from engine.scene.placement import axes
from engine.scene.plan import Lines, cross_in_plan, sine_of_angle

ANGLE = st.floats(-180, 180)
SIZE = st.floats(0.5, 3.0)


@st.composite
def families(draw):
    frame = axes((0.0, 0.0, draw(ANGLE)))
    start = np.array([draw(st.floats(-2, 2)), draw(st.floats(-2, 2)), draw(st.floats(-1, 1))])
    return Lines(start, frame[:, 1], draw(st.floats(0.1, 0.5)) * frame[:, 0], draw(st.integers(1, 12)), draw(SIZE))


@given(families(), families())
def test_crossings_are_those_of_every_pair(a, b):
    normal = np.array([0.0, 0.0, 1.0])
    assume(abs(sine_of_angle(a, b, normal)) > 0.05)
    expected, borderline = set(), set()
    for i in range(a.count):
        for j in range(b.count):
            apart = (b.start + j * b.step - a.start - i * a.step)[:2]
            u, v = np.linalg.solve(np.column_stack([a.along[:2], -b.along[:2]]), apart)
            inside = min(u, a.length - u, v, b.length - v)
            if inside > 0:
                expected.add((i, j))
            if abs(inside) < 1e-9:
                borderline.add((i, j))
    crossings = cross_in_plan(a, b, normal)
    i, j = crossings.lines()
    assert crossings.count == len(i) == len(j)
    found = set(zip(i.tolist(), j.tolist(), strict=True))
    assert len(found) == crossings.count
    assert found ^ expected <= borderline
    u, v = crossings.distances(i, j)
    np.testing.assert_allclose(a.at(i, u)[:, :2], b.at(j, v)[:, :2], atol=1e-12)
