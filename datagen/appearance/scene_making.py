"""Makes the scene of a picture from an appearance and a face."""

from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.accessories.accessories import accessory_meshes, hidden_hair
from datagen.appearance.appearance import Appearance
from datagen.appearance.hair.hair import Hair, hair_meshes, hair_uniforms
from datagen.appearance.light.shading import light_uniforms, shadow_lights
from datagen.appearance.person import head_from_torso
from datagen.appearance.scene import Colour, PosedHead, Scene, Surface, UniformValue
from datagen.appearance.skin.skin import Skin
from datagen.appearance.skin.tone import albedo_of_skin, density_of_melanin
from datagen.appearance.skin.uniforms import skin_uniforms
from datagen.sampling.expressions import strengths_of
from pix2face.face_files.coefficients import Face
from pix2face.models.morphable_model import MorphableModel


@final
class SceneMaker:
    """Makes scenes with heads of the built-in model."""

    def __init__(self, model: MorphableModel) -> None:
        self.model = model
        self._surface = Surface(model)

    def scene(self, appearance: Appearance, face: Face, vertices: Float32[ndarray, "v 3"]) -> Scene:
        """Makes the scene of one picture, from the vertices of the face in mm, model frame."""
        head = PosedHead(
            model=self.model,
            vertices=vertices,
            normals=self._surface.normals(vertices),
            neutral=self._neutral(face, vertices),
            named_expressions=strengths_of(face.attributes),
        )
        turned = head_from_torso(appearance.torso, face.camera)
        skin, hair = appearance.skin, appearance.hair
        worn = accessory_meshes(appearance.accessories, head, _colour(skin), hair.scalp_colour, turned)
        grown = hair_meshes(hair, head, hidden_hair(appearance.accessories))
        uniforms = {
            **skin_uniforms(skin, head),
            **_hair_on_skin(hair),
            **hair_uniforms(hair),
            **light_uniforms(appearance.light, face.camera),
        }
        lights = shadow_lights(appearance.light, face.camera)
        return Scene(head=head, meshes=(*grown, *worn), uniforms=uniforms, lights=lights)

    def _neutral(self, face: Face, vertices: Float32[ndarray, "v 3"]) -> Float32[ndarray, "v 3"]:
        """Subtracts the expression from a face, which reads a third of the data that adding up the identity would."""
        basis = self.model.expression_basis.reshape(self.model.n_expression, -1)
        return vertices - (face.expression.astype(np.float32) @ basis).reshape(vertices.shape)


def _hair_on_skin(hair: Hair) -> dict[str, UniformValue]:
    """Returns the uniforms of short hair, which is painted on the skin. Brows are meshes."""
    return {
        "skin_hair_colour": hair.scalp_colour,
        "skin_scalp_hair": hair.hairdo.scalp_density,
        "skin_beard_colour": hair.scalp_colour,
        "skin_brow_strength": 0.0,
    }


def _colour(skin: Skin) -> Colour:
    """Returns the linear colour of skin without marks and make-up, for neck, shoulders and hands."""
    red, green, blue = albedo_of_skin(density_of_melanin(skin.melanin), skin.haemoglobin).tolist()
    return red, green, blue
