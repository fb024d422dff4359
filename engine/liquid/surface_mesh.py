"""The surface of a liquid as a mesh to look at; the simulation knows nothing of it."""

import numpy as np
from numpy.typing import NDArray

from engine.arrays import Floats, Singles

# In radii of particles, that is half their mean distance.
SMOOTHING = 2.0  # of the kernel, whose support is twice as wide
CUBE = 1.0  # side of a marching cube: small enough for drops of one particle
THRESHOLD = 0.55  # of the interpolated colour field: that at which blocks enclose the volume of their particles
SMOOTHINGS = 10  # passes over the mesh


def surface(x: Floats, volume: Floats) -> tuple[Singles, NDArray[np.int32]]:
    """Return a closed mesh around the particles: vertices [m], shape [N, 3], and faces seen from outside, shape [T, 3].

    Particles `x` [m], shape [P, 3], of `volume` [m^3], shape [P], count as if all had the mean volume. A block of some
    thousands encloses their volume to 2 %, a drop of one four fifths, a sheet of one layer a quarter more. The mesh is the
    same on any number of threads.
    Source: Löschner 2023, weighted Laplacian smoothing of marching cubes, by the library splashsurf.
    """
    if len(x) == 0:
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
    from pysplashsurf import TriMesh3d, reconstruction_pipeline  # only where a surface is asked for

    found, _ = reconstruction_pipeline(
        x, particle_radius=np.cbrt(volume.mean()) / 2, smoothing_length=SMOOTHING, cube_size=CUBE,
        iso_surface_threshold=THRESHOLD, mesh_cleanup=True, decimate_barnacles=True, mesh_smoothing_iters=SMOOTHINGS,
    )
    assert isinstance(found.mesh, TriMesh3d)
    return np.array(found.mesh.vertices, np.float32), np.array(found.mesh.triangles, np.int32)
