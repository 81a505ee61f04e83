import bpy
import numpy as np

from drapeline.blender.scene import add_mesh, new_scene

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float32)
CUBE_FACES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)


def test_a_mesh_keeps_its_vertices_faces_and_their_order():
    scene = new_scene()
    cube = add_mesh("cube", CUBE, CUBE_FACES, (0.9, 0.1, 0.1))
    assert list(scene.collection.objects) == [cube]
    stored = np.zeros(CUBE.size, dtype=np.float32)
    cube.data.vertices.foreach_get("co", stored)
    np.testing.assert_array_equal(stored.reshape(-1, 3), CUBE)
    assert [list(polygon.vertices) for polygon in cube.data.polygons] == CUBE_FACES.tolist()
    assert len(cube.data.edges) == 12
    np.testing.assert_allclose(cube.color[:3], (0.9, 0.1, 0.1), atol=1e-6)


def test_a_new_scene_forgets_the_last():
    new_scene()
    add_mesh("cube", CUBE, CUBE_FACES)
    scene = new_scene()
    assert not scene.collection.objects
    assert not bpy.data.meshes
