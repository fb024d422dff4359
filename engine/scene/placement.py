"""Where the parts of a scene stand."""

from scipy.spatial.transform import Rotation

from engine.arrays import Floats


def axes(rotation: tuple[float, float, float]) -> Floats:
    """Return the local axes as columns [3, 3] after `rotation` about the fixed x, y, z axes [degrees]."""
    return Rotation.from_euler("xyz", rotation, degrees=True).as_matrix()
