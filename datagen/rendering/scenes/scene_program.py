"""The programs that draw scenes: their shaders, their uniforms by name, and the textures that they read."""

import struct
from collections.abc import Mapping, Sequence
from typing import Any, Literal, final

import moderngl
import numpy as np
from numpy import ndarray

from datagen.appearance.scene import Texture, UniformValue
from datagen.rendering.gl_mesh import shader_source
from pix2face.errors import UsageError

MaterialKind = Literal["object", "hair", "glass"]
KINDS: tuple[MaterialKind, ...] = ("object", "hair", "glass")
# Each kind has a program for each purpose: opaque objects, transparent objects, and their shadows.
PURPOSES = ("object", "blended", "object_shadow")
# What paints the head, in this order: each paints its own pixels and those of the later ones, which paint them over.
HEAD_KINDS = ("OUTSIDE", "EYES", "MOUTH")

# Where the drawer's own textures are bound, in all programs; those of the parts follow.
UNITS = {
    name: unit
    for unit, name in enumerate(
        (
            "shadow_maps",
            "seen",
            "head_corners",
            "head_positions",
            "head_normals",
            "head_places",
            "head_paint0",
            "head_paint1",
            "edges",
            "no_texture",
        )
    )
}
FIRST_FREE_UNIT = len(UNITS)
SAMPLER_2D_ARRAY = 0x8DC1

# How all fragment shaders begin, and where each kind of object gets its colours from.
_BEFORE = ("colour", "surface", "shadow", "scene_inputs")
_PAINT = {"object": "material", "hair": "hair", "glass": "material"}


@final
class SceneProgram:
    """A program of named parts of shaders. Its uniforms are set by name; names that it does not have are ignored."""

    def __init__(
        self, context: moderngl.Context, vertex: Sequence[str], fragment: Sequence[str], defines: Sequence[str] = ()
    ) -> None:
        self.program = context.program(
            vertex_shader=_source(vertex, defines), fragment_shader=_source(fragment, defines)
        )
        members: dict[str, Any] = {name: self.program[name] for name in self.program}
        uniforms: dict[str, Any] = {name: each for name, each in members.items() if isinstance(each, moderngl.Uniform)}
        self.uniforms = {name: _Slot(name, each) for name, each in uniforms.items()}
        self.attributes = {name for name, each in members.items() if isinstance(each, moderngl.Attribute)}
        self.set(UNITS)
        # Textures that nobody gives: two kinds of samplers must not read the same unit.
        arrays = [name for name, each in uniforms.items() if each.gl_type == SAMPLER_2D_ARRAY]
        self.set(dict.fromkeys(arrays, UNITS["no_texture"]))

    def set(self, values: Mapping[str, UniformValue]) -> None:
        """Sets the uniforms that the program has; the others belong to other programs.

        Arrays may be shorter than the shader's; matrices are given row by row.

        Raises:
            UsageError: A value has another size than its uniform.
        """
        set_uniforms([self], values)


def set_uniforms(programs: Sequence[SceneProgram], values: Mapping[str, UniformValue]) -> None:
    """As ``SceneProgram.set`` for several programs; each value is converted to bytes once for all of them.

    Raises:
        UsageError: A value has another size than its uniform.
    """
    for name, value in values.items():
        made: dict[tuple[Any, int], bytes] = {}
        for program in programs:
            found = program.uniforms.get(name)
            if found is not None:
                content = made.get(found.form)
                if content is None:
                    content = made[found.form] = found.content(value)
                found.write(content)


def used_programs(
    programs: Mapping[str, SceneProgram], kinds: Mapping[str, set[MaterialKind]]
) -> dict[str, SceneProgram]:
    """The programs that a scene uses: all but those for kinds of objects that it does not have."""
    idle = {f"{kind} {purpose}" for purpose in PURPOSES for kind in KINDS if kind not in kinds[purpose]}
    return {name: program for name, program in programs.items() if name not in idle}


@final
class SceneTextures:
    """The textures of all parts on the GPU, each with the name of its sampler and a unit of its own.

    Raises:
        UsageError: There are more than the driver binds at once, or one has a kind of numbers that it does not take.
    """

    def __init__(self, textures: Mapping[str, Texture], context: moderngl.Context) -> None:
        limit = int(context.info["GL_MAX_COMBINED_TEXTURE_IMAGE_UNITS"]) - FIRST_FREE_UNIT
        if len(textures) > limit:
            raise UsageError(f"expected at most {limit} textures of a scene, found {len(textures)}")
        self.units = {name: FIRST_FREE_UNIT + place for place, name in enumerate(textures)}
        self._arrays = {name: _uploaded(name, texture, context) for name, texture in textures.items()}

    def bind(self) -> None:
        """Puts each at its unit."""
        for name, array in self._arrays.items():
            array.use(self.units[name])


def is_ordinary(uniforms: Mapping[str, UniformValue]) -> bool:
    """Whether a scene lacks what few have: a gobo and face paint.

    Software drivers execute both branches of an ``if``, so ordinary scenes have programs without that code.
    """
    paint: Any = uniforms.get("skin_face_paint_a", (0, 0, 0, 0))
    return not uniforms.get("light_gobo", 0) and not paint[3]


def compile_programs(context: moderngl.Context, *, for_ordinary: bool) -> dict[str, SceneProgram]:
    """All programs by name: ``HEAD_KINDS``, and a kind and a purpose of objects."""
    defines = ("ORDINARY",) if for_ordinary else ()
    programs = {kind: _compile_head(context, kind, defines) for kind in HEAD_KINDS}
    for kind in KINDS:
        for purpose in PURPOSES:
            programs[f"{kind} {purpose}"] = _compile_object(context, kind, purpose, defines)
    return programs


def _compile_head(context: moderngl.Context, kind: str, defines: Sequence[str]) -> SceneProgram:
    """The program that paints and lights one of ``HEAD_KINDS`` where it is seen."""
    fragment = (*_BEFORE, "lamps", "light", "skin", "head_fragment")
    program = SceneProgram(context, ("whole_vertex",), fragment, (kind, "NO_STRANDS", *defines))
    program.set({"whole_depth": 0.5 * HEAD_KINDS.index(kind) - 0.75})  # just before its kind in scene_edges.py
    return program


def _compile_object(
    context: moderngl.Context, kind: MaterialKind, purpose: str, defines: Sequence[str]
) -> SceneProgram:
    """A program for objects of one kind: ``object`` (opaque), ``blended`` or ``object_shadow``."""
    paint = ("object_inputs", "lamps", "light", _PAINT[kind], "object_surface", f"{purpose}_fragment")
    is_hair = kind == "hair"
    vertex = ("colour", "shadow", "lamps", "hair_vertex") if is_hair else ("scene_vertex",)
    defines = [kind.upper(), *defines]
    if purpose == "object_shadow":
        defines.append("SHADOW")
    if not is_hair:
        defines.append("NO_STRANDS")
    return SceneProgram(context, vertex, (*_BEFORE, *paint), defines)


@final
class _Slot:
    """A uniform and the conversion of values to its bytes.

    Attributes:
        form: Uniforms of the same form and name take the same bytes.
    """

    def __init__(self, name: str, found: Any) -> None:
        self._name, self._uniform = name, found
        kind = found.fmt[-1]
        self._kind = {"f": np.float32, "i": np.int32}[kind]
        self._size = found.array_length * found.dimension
        self._pack = struct.Struct(f"{self._size}{kind}").pack
        self._written = b""
        self.form = found.fmt, found.array_length

    def content(self, value: UniformValue) -> bytes:
        """The bytes of a value."""
        if isinstance(value, int | float) and self._size == 1:
            return self._pack(value)
        if isinstance(value, tuple) and len(value) == self._size:
            return self._pack(*value)
        return self._packed(np.asarray(value, dtype=self._kind))

    def write(self, content: bytes) -> None:
        """Sets it, where that changes anything."""
        if content != self._written:
            self._uniform.write(content)
            self._written = content

    def _packed(self, numbers: ndarray) -> bytes:
        found = self._uniform
        if found.matrix:
            numbers = np.swapaxes(numbers, -1, -2)
        if numbers.size == self._size:
            return numbers.tobytes()
        # The shader's compiler drops the tail of an array that is never read.
        is_array = numbers.ndim == 1 + (found.dimension > 1) + bool(found.matrix)
        if not is_array or numbers.size % found.dimension:
            raise UsageError(f"{self._name}: expected {self._size} numbers, as the shader says, found {numbers.shape}")
        padded = np.zeros(self._size, dtype=self._kind)
        padded[: numbers.size] = numbers.reshape(-1)[: self._size]
        return padded.tobytes()


def _source(parts: Sequence[str], defines: Sequence[str]) -> str:
    version, _, body = shader_source(330, *parts).partition("\n")
    return "\n".join([version, *(f"#define {name}" for name in defines), body])


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
