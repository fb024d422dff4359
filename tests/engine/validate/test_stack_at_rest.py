"""Normal forces in a stack at rest: every layer shows the weight of all that lies on it."""

import numpy as np
import pytest

from engine.validate.eol_march import March
from engine.validate.eol_separate import COTTON, SPACING
from engine.validate.rods import DOWN, EARTH
from engine.yarns.model import PointKind

LAYERS = 3
AT_REST = 0.1  # [s]


def scene(offsets):
    """Three layers on a fixed one, each `offset` from its weave [spacings]."""
    fabric = {"material": "cotton", "spacing": SPACING, "warps": 5, "wefts": 5}
    names = [f"layer{k}" for k in range(LAYERS)]
    return {
        "strandline": 1, "name": "stack", "gravity": DOWN.tolist(), "duration": 1.0, "materials": {"cotton": COTTON},
        "fabrics": [
            fabric | {"name": "fixed", "warps": 10, "wefts": 10, "kinematic": True},
            *(fabric | {"name": name, "position": [SPACING * x, SPACING * y, 0.0]}
              for name, (x, y) in zip(names, offsets, strict=True)),
        ],
        "contacts": [
            {"lower": lower, "upper": upper} for lower, upper in zip(["fixed", *names], names, strict=False)
        ],
    }


@pytest.mark.parametrize("offsets", [
    ((0.23, 0.13), (0.41, 0.36), (0.02, 0.45)),
    ((0.23, 0.13), (0.6, 0.5), (-0.2, 0.8)),  # the topmost overhangs
])
def test_contacts_carry_the_weight_of_all_layers_above(offsets):
    march = March(scene(offsets))
    march.reach(AT_REST)
    model = march.model
    weight = EARTH * np.bincount(model.fabric, model.density * model.length)
    fabric = model.fabric[model.node_yarn[model.point_nodes]]
    for below in range(LAYERS):
        between = (model.point_kind == PointKind.CONTACT) & (fabric == (below, below + 1)).all(axis=1)
        assert march.state.normal_force[between].sum() == pytest.approx(weight[below + 1:].sum(), rel=1e-2)
    assert march.state.eil.any()  # some of it by the constraint's force
