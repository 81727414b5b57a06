import numpy as np

from pix2face.models.surface_attributes import vertex_normals
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


def test_normals_point_outward_and_have_unit_length() -> None:
    normals = vertex_normals(MODEL.mean, MODEL.triangles)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    smooth = MODEL.mean[:, 2] > 30
    towards = MODEL.mean / np.linalg.norm(MODEL.mean, axis=1, keepdims=True)
    assert np.einsum("vi,vi->v", normals, towards)[smooth].min() > 0.3
    isolated = np.vstack([MODEL.mean, [[0, 0, 0]]])
    assert not vertex_normals(isolated, MODEL.triangles)[-1].any()


def test_larger_triangles_count_more() -> None:
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 1]], dtype=np.float32)
    triangles = np.array([[0, 1, 2], [0, 3, 1]])  # areas 8 and 2, facing +z and +y
    np.testing.assert_allclose(vertex_normals(vertices, triangles)[0], np.array([0, 2, 8]) / np.hypot(2, 8))
