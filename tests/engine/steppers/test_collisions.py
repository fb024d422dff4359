"""Yarns in motion that collide without contact points between them."""

import numpy as np
import pytest

from engine.validate.eol_march import March
from engine.yarns import observe
from tests.engine.contact.test_sphere_packing import folded
from tests.engine.scene.scenes import cloth, scene_of

RADIUS, GRAVITY = 2.25e-3, [0.0, 0.0, -9.81]


def on_their_way(speed, **lower):
    """Two cloths, the upper one 2 cm above and turned, thrown down on the lower one."""
    fabrics = [cloth("lower", warps=6, wefts=6, material="undamped", **lower),
               cloth("upper", material="undamped", position=[0.002, 0.001, 0.02], rotation=[0, 0, 20])]
    material = {"radius": RADIUS, "volume_density": 770.0, "youngs_modulus": 5e5, "bending_modulus": 1e5}
    march = March(scene_of(fabrics=fabrics, contact={"self": True}, gravity=GRAVITY, materials={"undamped": material}))
    march.state.velocity[march.model.fabric[march.model.node_yarn] == 1] = [0.0, 0.0, -speed]
    return march


def heights(march, fabric):
    return march.state.x[march.model.node_point[march.model.fabric[march.model.node_yarn] == fabric], 2]


@pytest.mark.parametrize("lower", [{"kinematic": True}, {"pins": "edges"}], ids=["given", "held"])
def test_a_cloth_lands_on_a_cloth(lower):
    march = on_their_way(1.0, **lower)
    collisions = 0
    for attempt in march.attempts(0.05):
        assert attempt.report.accepted
        collisions = max(collisions, attempt.report.collisions)
        assert heights(march, 1).min() > heights(march, 0).min() + RADIUS
    assert collisions > 20
    if "kinematic" in lower:
        np.testing.assert_allclose(heights(march, 1), 2.0 * RADIUS, rtol=0.05)


def test_momentum_is_kept_when_cloths_collide_in_flight():
    march = on_their_way(1.0)
    march.pull(np.array(GRAVITY), tolerance=1e-3)  # momentum is kept as far as Newton goes
    before = observe.momentum(march.model, march.state)
    march.reach(0.04)
    wanted = before + march.free_mass * march.time * np.array(GRAVITY)
    np.testing.assert_allclose(observe.momentum(march.model, march.state), wanted, atol=1e-5 * np.linalg.norm(before))
    velocity = [march.state.x_rate[march.model.node_point[march.model.fabric[march.model.node_yarn] == k], 2].mean()
                for k in (0, 1)]
    assert velocity[0] <= velocity[1] + 1e-9, "they have exchanged momentum and do not approach any more"
    assert heights(march, 1).min() > heights(march, 0).min()


def test_a_strip_folds_on_itself():
    radius = 1e-3
    limp = {"radius": radius, "volume_density": 770.0, "youngs_modulus": 5e5, "bending_modulus": 3e4, "mass_damping": 20.0}
    strip = cloth(material="limp", warps=4, wefts=28, spacing=2.5e-3, position=[0, 0, radius])
    march = March(scene_of(fabrics=[strip], obstacles=[{"shape": "plane"}], contact={"self": True}, materials={"limp": limp}))
    folded(march, 6e-3, -5e-3)
    march.state.obstacle_anchor[:] = march.state.x
    march.reach(0.25)
    y, z = march.state.x[:, 1], march.state.x[:, 2]
    upper = (z > 2.0 * radius) & (y < -0.012)
    assert upper.sum() > 15, "the upper half lies on the lower one"
    assert z[upper].min() > 3.0 * radius * 0.95 and z.min() > 0.9 * radius


def test_a_step_in_which_yarns_would_pass_through_each_other_is_rejected():
    march = on_their_way(30.0, kinematic=True)
    reasons = {attempt.report.reason for attempt in march.attempts(0.002)}
    assert reasons <= {"", "yarns passed through each other", "Newton did not converge", "the line search found no descent"}
    assert heights(march, 1).min() > 0.5 * RADIUS
