"""Builds networks in the format ONNX, without the package onnx: it takes a quarter of a second to load.

Source: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto, whose messages and numbers of fields stand in comments.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from typing import Final, final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

OPSET: Final = 18
IR_VERSION: Final = 9
DATA_TYPES: Final = {"float32": 1, "int64": 7, "float16": 10}  # TensorProto.DataType
Attribute = int | float | str | Sequence[int]
Shape = Sequence[int | str]  # numbers, or names of what may have any size


@final
class OnnxGraph:
    """A graph that grows node by node. Each method returns the name of what it adds.

    Args:
        half: Whether matrices are stored in float16. They are converted to float32 when a file is opened; vectors, as
            norms and biases are, stay float32.
    """

    def __init__(self, *, half: bool = False) -> None:
        self._half = half
        self._nodes: list[bytes] = []
        self._arrays: list[bytes] = []
        self._inputs: list[bytes] = []
        self._outputs: list[bytes] = []
        self._numbers: Iterator[int] = count()

    def input(self, name: str, shape: Shape) -> str:
        """An input of the network, float32."""
        self._inputs.append(_value_info(name, shape))
        return name

    def output(self, name: str, value: str, shape: Shape) -> str:
        """Makes a value an output of the network."""
        self._outputs.append(_value_info(name, shape))
        return self.node("Identity", value, output=name)

    def array(self, values: ndarray) -> str:
        """A constant: float32, float16 or int64."""
        name = f"array_{next(self._numbers)}"
        self._arrays.append(_tensor(name, values))
        return name

    def weight(self, values: Float32[ndarray, "..."]) -> str:
        """A constant that may be stored in float16."""
        if not self._half or values.ndim < 2:
            return self.array(values)
        with np.errstate(over="ignore"):
            return self.node("Cast", self.array(values.astype(np.float16)), to=DATA_TYPES["float32"])

    def node(self, operator: str, *inputs: str, output: str | None = None, **attributes: Attribute) -> str:
        """Applies an operator of ONNX (https://onnx.ai/onnx/operators/)."""
        output = output or f"{operator.lower()}_{next(self._numbers)}"
        fields: list[tuple[int, _Field]] = [(1, name) for name in inputs]
        fields += [(2, output), (4, operator)]
        fields += [(5, _attribute(name, value)) for name, value in attributes.items()]
        self._nodes.append(_message(*fields))  # NodeProto
        return output

    def content(self, metadata: Mapping[str, str] = {}, description: str = "") -> bytes:
        """The bytes of an ONNX file."""
        graph = _message(
            *((1, node) for node in self._nodes),
            (2, "pix2face"),
            *((5, array) for array in self._arrays),
            *((11, own) for own in self._inputs),
            *((12, own) for own in self._outputs),
        )
        return _message(  # ModelProto
            (1, IR_VERSION),
            (2, "pix2face"),
            (6, description),
            (7, graph),
            (8, _message((2, OPSET))),
            *((14, _message((1, name), (2, value))) for name, value in metadata.items()),
        )


_Field = int | float | str | bytes


def _message(*fields: tuple[int, _Field]) -> bytes:
    """A protobuf message: each field with its number."""
    parts = []
    for number, value in fields:
        if isinstance(value, int):
            parts += [_varint(number << 3), _varint(value)]
        elif isinstance(value, float):
            parts += [_varint(number << 3 | 5), np.float32(value).tobytes()]
        else:
            content = value.encode() if isinstance(value, str) else value
            parts += [_varint(number << 3 | 2), _varint(len(content)), content]
    return b"".join(parts)


def _varint(value: int) -> bytes:
    """A whole number, seven bits a byte, those that count least first."""
    value &= (1 << 64) - 1
    found = bytearray()
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    found.append(value)
    return bytes(found)


def _tensor(name: str, values: ndarray) -> bytes:
    sizes = ((1, size) for size in values.shape)
    data = np.ascontiguousarray(values).tobytes()
    return _message(*sizes, (2, DATA_TYPES[values.dtype.name]), (8, name), (9, data))  # TensorProto


def _attribute(name: str, value: Attribute) -> bytes:
    """AttributeProto: a value has a field and a type of its kind."""
    match value:
        case int():
            return _message((1, name), (3, value), (20, 2))
        case float():
            return _message((1, name), (2, value), (20, 1))
        case str():
            return _message((1, name), (4, value), (20, 3))
        case _:
            return _message((1, name), *((8, number) for number in value), (20, 7))


def _value_info(name: str, shape: Shape) -> bytes:
    dimensions = [(1, _message((2 if isinstance(size, str) else 1, size))) for size in shape]
    tensor = _message((1, DATA_TYPES["float32"]), (2, _message(*dimensions)))  # TypeProto.Tensor
    return _message((1, name), (2, _message((1, tensor))))  # ValueInfoProto
