"""Which particles leave."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from engine.liquid.model import LiquidModel
from engine.liquid.sinks import LiquidSinks, leaving

COORDINATE = st.integers(-8, 8).map(lambda k: 0.25 * k)  # so that places on faces are met
BOX = arrays(float, (2, 3), elements=COORDINATE).map(lambda corners: np.sort(corners, axis=0))


def model(low, high):
    return LiquidModel(
        density=1000.0, bulk_modulus=np.inf, shear_modulus=0.0, yield_stress=0.0, consistency=0.0, flow_index=1.0,
        surface_tension=0.0, tearing_strain=np.inf, recovery_rate=0.0, spacing=0.1, origin=np.zeros(3),
        period=np.zeros(3, np.int64), no_slip=False, low=low, high=high)


def reference_leaving(sinks, low, high, x):
    in_sink = [any((a <= p).all() and (p <= b).all() for a, b in zip(sinks.low, sinks.high, strict=True)) for p in x]
    outside = [(p < low).any() or (p > high).any() for p in x]
    return np.array(in_sink, bool) | np.array(outside, bool)


@settings(deadline=None)  # it compiles
@given(st.lists(BOX, max_size=3), BOX, arrays(float, (7, 3), elements=COORDINATE))
def test_leaving(boxes, world, x):
    sinks = LiquidSinks(np.array([box[0] for box in boxes]).reshape(-1, 3), np.array([box[1] for box in boxes]).reshape(-1, 3))
    np.testing.assert_array_equal(leaving(sinks, model(*world), x), reference_leaving(sinks, *world, x))
