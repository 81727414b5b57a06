"""What is computed from the attributes of samples: conditions such as ``abs(yaw_deg) < 60 and light.kind == 'studio'``.

The language is a small part of Python's: comparisons (also ``in``), ``and``, ``or``, ``not``, numbers, texts, lists,
``+ - * /``, and the functions ``abs``, ``min`` and ``max``. Names are those of attributes, with their dots
(``light.kind``), and ``sample_id``. Nothing else can be written, so conditions from untrusted sources are safe.

A sample may lack an attribute that others have (photographs have no kind of light). What is not there equals nothing:
``!=`` and ``not in`` hold, any other comparison does not. But what a synthetic photograph was drawn from is stored
without its zeros: ``skin.stubble`` is 0 for a sample that lacks it and has other attributes ``skin.``. So
``accessories.glasses.lift < 0.5`` holds for glasses on a nose, and not for faces without glasses.
"""

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any, final

from pix2face.errors import UsageError

Attributes = Mapping[str, str | float]
Evaluate = Callable[[Attributes], Any]

SAMPLE_ID = "sample_id"
LARGEST_TEXT = 10_000
_COMPARISONS: Mapping[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}
_HOLD_FOR_NOTHING = (ast.NotEq, ast.NotIn)
_ARITHMETIC: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_SIGNS: Mapping[type[ast.unaryop], Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {"abs": abs, "min": min, "max": max}


@final
class AttributeExpression:
    """What is computed from the attributes of a sample, made ready. Remembers the names that it meets.

    Args:
        text: A condition, or any other expression of the language (``abs(yaw_deg)``).
        option: Of the command line, to name in errors.
        what: What the text is called in errors.

    Raises:
        UsageError: The text is not of this language.
    """

    def __init__(self, text: str, option: str, what: str = "an expression") -> None:
        self.text = text.strip()
        self._option = option
        self._used: set[str] = set()
        self._known: set[str] = {SAMPLE_ID}
        if len(text) > LARGEST_TEXT:
            raise self._error(f"expected at most {LARGEST_TEXT} characters, found {len(text)}")
        try:
            self._evaluate = self._compiled(ast.parse(self.text, mode="eval").body)
        except SyntaxError as error:
            raise self._error(f"expected {what}, found something else ({error.msg})") from error
        except (ValueError, RecursionError, MemoryError) as error:
            raise self._error(f"expected {what} that is not nested so deeply") from error

    def value(self, sample_id: str, attributes: Attributes) -> Any:
        """What it says of a sample; None where it computes with an attribute that the sample lacks.

        Raises:
            UsageError: It compares texts with numbers, divides by 0 or the like.
        """
        self._known |= attributes.keys()
        try:
            return self._evaluate({**attributes, SAMPLE_ID: sample_id})
        except (TypeError, ArithmeticError, ValueError) as error:
            values = {name: attributes[name] for name in sorted(self._used) if name in attributes}
            raise self._error(f"cannot be said of {sample_id!r} with {values}: {error}") from error

    def check_names(self) -> None:
        """Makes sure that each name was an attribute of a sample that was met.

        Raises:
            UsageError: One was not.
        """
        unknown = sorted(self._used - self._known)
        if unknown:
            raise self._error(f"expected attributes among {', '.join(sorted(self._known))}; found {unknown[0]!r}")

    def _error(self, what: str) -> UsageError:
        return UsageError(f"{self._option} {self.text[:80]!r}: {what}")

    def _compiled(self, node: ast.expr) -> Evaluate:
        match node:
            case ast.Constant(value=str() | int() | float() as value):
                return lambda _: value
            case ast.Name() | ast.Attribute() if dotted := _dotted(node):
                self._used.add(dotted)
                return lambda attributes: _attribute(attributes, dotted)
            case ast.BoolOp(op=op, values=values):
                parts, combined = [self._compiled(value) for value in values], all if isinstance(op, ast.And) else any
                return lambda attributes: combined(part(attributes) for part in parts)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                inner = self._compiled(operand)
                return lambda attributes: not inner(attributes)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _SIGNS:
                return _of_known(_SIGNS[type(op)], [self._compiled(operand)])
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _of_known(_ARITHMETIC[type(op)], [self._compiled(left), self._compiled(right)])
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS and arguments:
                return _of_known(_FUNCTIONS[name], [self._compiled(argument) for argument in arguments])
            case ast.List(elts=elements) | ast.Tuple(elts=elements) | ast.Set(elts=elements):
                parts = [self._compiled(element) for element in elements]
                return lambda attributes: [part(attributes) for part in parts]
            case ast.Compare(left=left, ops=ops, comparators=comparators):
                return _chained([self._compiled(side) for side in (left, *comparators)], [type(op) for op in ops])
        found = ast.unparse(node)[:40]
        raise self._error(
            f"expected comparisons, and, or, not, + - * /, {', '.join(_FUNCTIONS)} of attributes, found {found!r}"
        )


@final
class SampleFilter:
    """A condition, made ready; arguments and errors are those of ``AttributeExpression``."""

    def __init__(self, text: str, option: str) -> None:
        self._condition = AttributeExpression(text, option, "a condition")

    def passes(self, sample_id: str, attributes: Attributes) -> bool:
        """Whether a sample fulfils the condition."""
        return bool(self._condition.value(sample_id, attributes))

    def check_names(self) -> None:
        """Makes sure that each name was an attribute of a sample that was met."""
        self._condition.check_names()


def _dotted(node: ast.expr) -> str:
    """``part.name``; empty for what is no name."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=value, attr=name) if before := _dotted(value):
            return f"{before}.{name}"
    return ""


def _attribute(attributes: Attributes, name: str) -> str | float | None:
    """An attribute; of a part that is there without it 0."""
    found = attributes.get(name)
    if found is not None:
        return found
    part = name.rpartition(".")[0] + "."
    return 0.0 if any(other.startswith(part) for other in attributes) else None


def _of_known(function: Callable[..., Any], arguments: list[Evaluate]) -> Evaluate:
    """A function of values; of one that is not there it is not there either."""

    def evaluate(attributes: Attributes) -> Any:
        values = [argument(attributes) for argument in arguments]
        return None if any(value is None for value in values) else function(*values)

    return evaluate


def _chained(sides: list[Evaluate], ops: list[type[ast.cmpop]]) -> Evaluate:
    """``a < b < c`` and the like."""
    if not all(op in _COMPARISONS for op in ops):
        raise SyntaxError("`is` compares no values; write ==")

    def evaluate(attributes: Attributes) -> bool:
        values = [side(attributes) for side in sides]
        for a, op, b in zip(values, ops, values[1:], strict=False):
            if a is None or b is None:
                if op not in _HOLD_FOR_NOTHING:
                    return False
            elif not _COMPARISONS[op](a, b):
                return False
        return True

    return evaluate
