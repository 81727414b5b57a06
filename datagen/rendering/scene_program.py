"""Programs that draw scenes: which shaders they are made of, their uniforms by name, and the textures they read."""

from collections.abc import Mapping, Sequence
from typing import Literal, final

import moderngl
import numpy as np
from numpy import ndarray

from datagen.appearance.scene import Texture, UniformValue
from datagen.rendering.gl_mesh import shader_source
from pix2face.errors import UsageError

MaterialKind = Literal["object", "hair", "glass"]
KINDS: tuple[MaterialKind, ...] = ("object", "hair", "glass")

# In front of what a part paints; then what it is painted with.
_BEFORE = ("colour", "surface", "shadow", "scene_inputs")
_PAINT = {"object": "material", "hair": "hair", "glass": "material"}


@final
class SceneProgram:
    """A program whose uniforms are set by name, as far as it has them.

    Args:
        program: What was compiled.
    """

    def __init__(self, program: moderngl.Program) -> None:
        self.program = program
        self._uniforms = {name: program[name] for name in program if isinstance(program[name], moderngl.Uniform)}

    def set(self, values: Mapping[str, UniformValue]) -> None:
        """Sets those that the program has; the others are of other programs.

        Arrays may be shorter than the shader's; matrices are given row by row.

        Raises:
            UsageError: A value has not the size of its uniform.
        """
        for name, value in values.items():
            found = self._uniforms.get(name)
            if found is not None:
                found.write(_packed(found, name, value))


@final
class SceneTextures:
    """The textures of all parts, in the driver for good: each under its sampler's name, at a unit of its own.

    Args:
        textures: By the sampler's name.
        context: Where.
        first_unit: The units before are somebody else's.

    Raises:
        UsageError: There are more than the driver binds at once, or one has a kind of numbers that it does not take.
    """

    def __init__(self, textures: Mapping[str, Texture], context: moderngl.Context, first_unit: int) -> None:
        limit = int(context.info["GL_MAX_TEXTURE_IMAGE_UNITS"])
        if first_unit + len(textures) > limit:
            raise UsageError(f"expected at most {limit - first_unit} textures of a scene, found {len(textures)}")
        self.units = {name: first_unit + place for place, name in enumerate(textures)}
        self._arrays = {name: _uploaded(name, texture, context) for name, texture in textures.items()}

    def bind(self) -> None:
        """Puts each at its unit."""
        for name, array in self._arrays.items():
            array.use(self.units[name])

    def release(self) -> None:
        """Gives them back to the driver."""
        for array in self._arrays.values():
            array.release()


def compile_head(context: moderngl.Context) -> SceneProgram:
    """The program that paints and lights a head."""
    defines = ("#define HEAD",)
    return _compiled(context, defines, ("scene_vertex",), (*_BEFORE, "light", "skin", "head_fragment"))


def compile_object(context: moderngl.Context, kind: MaterialKind, last: str) -> SceneProgram:
    """A program for objects of one kind; ``last`` is the shader that says what becomes of the painted surface."""
    paint = ("object_inputs", "light", _PAINT[kind], "object_surface", last)
    return _compiled(context, (f"#define {kind.upper()}",), ("scene_vertex",), (*_BEFORE, *paint))


def compile_label(context: moderngl.Context) -> SceneProgram:
    """The program of which nothing but the place of a triangle counts."""
    return _compiled(context, (), ("label_vertex",), ("label_fragment",))


def _compiled(
    context: moderngl.Context, defines: Sequence[str], vertex: Sequence[str], fragment: Sequence[str]
) -> SceneProgram:
    sources = []
    for parts in (vertex, fragment):
        version, _, body = shader_source(330, *parts).partition("\n")
        sources.append("\n".join([version, *defines, body]))
    return SceneProgram(context.program(vertex_shader=sources[0], fragment_shader=sources[1]))


def _packed(found: moderngl.Uniform, name: str, value: UniformValue) -> bytes:
    """The bytes of a value, as many as the uniform has."""
    kind = {"f": np.float32, "i": np.int32, "u": np.uint32}[found.fmt[-1]]
    numbers = np.asarray(value, dtype=kind)
    if found.matrix:
        numbers = np.swapaxes(numbers, -1, -2)
    wanted, given = found.array_length * found.dimension, numbers.size
    # The shader's compiler drops the tail of an array that is never read.
    fits = given == wanted or (numbers.ndim > 0 and given % found.dimension == 0 and _is_array(found, numbers))
    if not fits:
        raise UsageError(f"{name}: expected {wanted} numbers, as the shader says, found {numbers.shape}")
    padded = np.zeros(wanted, dtype=kind)
    padded[: min(given, wanted)] = numbers.reshape(-1)[:wanted]
    return padded.tobytes()


def _is_array(found: moderngl.Uniform, numbers: ndarray) -> bool:
    return bool(numbers.ndim == 1 + (found.dimension > 1) + bool(found.matrix))


def _uploaded(name: str, texture: Texture, context: moderngl.Context) -> moderngl.TextureArray:
    pixels = np.ascontiguousarray(texture.pixels)
    kinds = {np.dtype(np.uint8): "f1", np.dtype(np.float16): "f2"}
    if pixels.dtype not in kinds or pixels.ndim != 4 or pixels.shape[3] > 4:
        raise UsageError(
            f"texture {name}: expected UInt8 or Float16 in layers, rows, columns and up to 4 channels, "
            f"found {pixels.dtype} {pixels.shape}"
        )
    layers, height, width, channels = pixels.shape
    array = context.texture_array((width, height, layers), channels, pixels, alignment=1, dtype=kinds[pixels.dtype])
    array.repeat_x = array.repeat_y = texture.repeat
    array.filter = (moderngl.LINEAR, moderngl.LINEAR)
    if texture.mipmaps:
        array.build_mipmaps()
        array.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    return array
