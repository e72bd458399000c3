"""The bodies' layers in one volume, as texture filters read them."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from milkglass.core.geometry.bodies import find_bodies
from milkglass.core.grid.atlas import fit_atlas
from milkglass.core.grid.layers import fit_nodes
from tests.support.solids import ball, mesh_of, plates, rings

BALLS = mesh_of(*(ball(3.0, (9.0 * i, 0.0, 0.0)) for i in range(5)))
MODELS = {"plates": plates(), "rings": mesh_of(*rings()), "balls": BALLS}
FILTER = 1.0 / 256.0  # of a texel: weights of texture filters have 8 bits


def atlas_of(mesh):
    bodies = find_bodies(mesh).of_face
    body = np.empty(len(mesh.vertices), int)
    body[mesh.faces] = bodies[:, None]
    return fit_atlas(fit_nodes(mesh.bounds, 40), tsc=True, vertices=mesh.vertices, body=body)


def read(atlas, volume, i, places, off=0.0):
    """Filtered values of a volume at places in the world, (n, 3), as pixels of body i read them; `off` in texels."""
    shift, first, last = atlas.windows[i].astype(float)
    coordinates = (np.c_[places, np.ones(len(places))] @ atlas.world_to_texture)[:, :3]
    texels = np.clip(coordinates + shift, first, last) * np.array(atlas.shape)[::-1] - 0.5 + off
    return map_coordinates(volume, texels[:, ::-1].T, order=1, mode="nearest")


@pytest.mark.parametrize("model", MODELS)
def test_a_place_reads_its_node(model):
    """At all nodes of a body, those at the ends of its layers too."""
    atlas, rng = atlas_of(MODELS[model]), np.random.default_rng(0)
    crops = [rng.random((1, *crop.shape), dtype=np.float32) for crop in atlas.crops]
    (volume,) = atlas.assembled(crops, 1)
    for i, crop in enumerate(atlas.crops):
        nodes = np.stack([axis.ravel() for axis in np.indices(crop.shape)])[::-1].T
        to_world = np.linalg.inv(np.array(crop.world_to_grid))
        places = (np.c_[nodes, np.ones(len(nodes))] @ to_world)[:, :3]
        np.testing.assert_allclose(read(atlas, volume, i, places), crops[i].ravel(), atol=1e-3)


@pytest.mark.parametrize("model", MODELS)
def test_no_body_reads_from_another(model):
    """Nor where a filter rounds beyond the last node, or a place lies outside of the body."""
    atlas = atlas_of(MODELS[model])
    (volume,) = atlas.assembled([np.full((1, *crop.shape), 1.0 + i) for i, crop in enumerate(atlas.crops)], 1)
    places = np.random.default_rng(1).uniform(*(2.0 * MODELS[model].bounds), (5000, 3))
    for i in range(len(atlas.crops)):
        for off in (-FILTER, FILTER):
            np.testing.assert_array_equal(read(atlas, volume, i, places, off), 1.0 + i)
