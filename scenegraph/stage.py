"""Stage: the base class of every culling method, with parameters and guarantees declared as data."""

from __future__ import annotations

import ast
import typing
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, dataclass_transform

from .errors import PipelineError, nearest

if TYPE_CHECKING:
    from .frame import Frame
    from .progress import Progress
    from .snapshot import Snapshot


class Guarantee(Enum):
    """What a stage promises about the rows it hides."""

    EXACT = "exact"
    """Hides all that cannot be seen and nothing else."""
    CONSERVATIVE = "conservative"
    """Hides nothing visible."""
    AGGRESSIVE = "aggressive"
    """May hide visible things, within the bound that `Stage.bound` states."""
    APPROXIMATE = "approximate"
    """May err both ways, without a bound."""


@dataclass(frozen=True)
class Parameter:
    """One setting of a stage. Command line, suites, sliders and docs are all made from this.

    Attributes
    ----------
    name, help : str
    type : type
        bool, int, float or str.
    default : the type's value
    minimum, maximum : float or None
        Inclusive bounds.
    unit : str
    choices : tuple of str
        The only values a str may have; empty for any.
    """

    name: str
    type: type
    default: Any
    minimum: float | None = None
    maximum: float | None = None
    unit: str = ""
    help: str = ""
    choices: tuple[str, ...] = ()

    def fault(self, value: Any) -> str | None:
        """Why a value is not allowed, or None."""
        ok = isinstance(value, self.type) or (self.type is float and isinstance(value, int))
        if not ok or (self.type is not bool and isinstance(value, bool)):
            return f"{self.name}={value!r} is not {'a number' if self.type is float else self.type.__name__}"
        unit = f" {self.unit}" if self.unit else ""
        if self.choices and value not in self.choices:
            return f"{self.name}={value!r};{nearest(value, self.choices)}"
        if self.type in (int, float) and value != value:
            return f"{self.name} is not a number"
        if self.minimum is not None and value < self.minimum:
            return f"{self.name}={value!r} is below its minimum {self.minimum:g}{unit}"
        if self.maximum is not None and value > self.maximum:
            return f"{self.name}={value!r} is above its maximum {self.maximum:g}{unit}"
        return None


@dataclass(frozen=True)
class _Declared:
    default: Any
    options: Mapping[str, Any]


def parameter(
    default: Any,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    unit: str = "",
    help: str = "",
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a stage parameter: ``pixels: float = parameter(1.0, minimum=0, unit="px", help="…")``.

    The annotation must be bool, int, float, str or a `typing.Literal` of strings (then `choices` follows from it).
    """
    options = {"minimum": minimum, "maximum": maximum, "unit": unit, "help": help, "choices": choices}
    return _Declared(default, options)


@dataclass_transform(field_specifiers=(parameter,), kw_only_default=True)
class Stage(ABC):
    """One step of a pipeline. Subclass it, name it, and write `run`.

    Class attributes
    ----------------
    name : str
        What users type; an identifier.
    reads : tuple
        Products (classes) that an earlier stage must have put into the frame.
    writes : tuple
        What `run` changes: "visible", "level", "standins", and classes of products that it puts into the frame. Calling
        a method of the frame that is not declared here raises.
    needs : tuple of str
        Names of preparations, or "gl" for a device. Where they depend on the parameters, set it in `__init__`.
    guarantee : Guarantee
        A property where it depends on the parameters.
    bound : str
        For an aggressive stage, the bound in words.
    minimum_candidates : int
        With fewer rows still visible the pipeline skips the stage and says so.
    """

    name: ClassVar[str] = ""
    reads: ClassVar[tuple[type, ...]] = ()
    writes: ClassVar[tuple[str | type, ...]] = ("visible",)
    needs: tuple[str, ...] = ()
    bound: str = ""
    minimum_candidates: int = 1

    @property
    def guarantee(self) -> Guarantee:
        """What the stage promises; a class attribute, or a property if it depends on the parameters."""
        return Guarantee.APPROXIMATE

    def __init__(self, **values: Any) -> None:
        known = self.parameters()
        faults = [
            f"stage {self.name!r} has no parameter {key!r}.{nearest(key, known)}" for key in values if key not in known
        ]
        for key, spec in known.items():
            value = values.get(key, spec.default)
            fault = spec.fault(value)
            if fault:
                faults.append(f"stage {self.name!r}: {fault}")
            elif spec.type is float:
                value = float(value)
            setattr(self, key, value)
        if faults:
            raise PipelineError(faults)

    @classmethod
    @cache
    def parameters(cls) -> dict[str, Parameter]:
        """The declared parameters by name, base classes first."""
        found: dict[str, Parameter] = {}
        hints: dict[str, Any] = {}
        for base in reversed(cls.__mro__):
            for key, value in vars(base).items():
                if isinstance(value, _Declared):
                    hints = hints or typing.get_type_hints(cls)
                    kind, options = hints[key], dict(value.options)
                    if typing.get_origin(kind) is Literal:
                        options["choices"] = typing.get_args(kind)
                        kind = str
                    if kind not in (bool, int, float, str):
                        raise TypeError(f"{cls.__name__}.{key}: parameters are bool, int, float, str or Literal")
                    found[key] = Parameter(key, kind, value.default, **options)
        return found

    @classmethod
    def summary(cls) -> str:
        """First line of the docstring."""
        return (cls.__doc__ or "").strip().partition("\n")[0]

    def values(self) -> dict[str, Any]:
        """Current value of each parameter."""
        return {key: getattr(self, key) for key in self.parameters()}

    @property
    def text(self) -> str:
        """As typed in a pipeline: the name, and the parameters that differ from their defaults."""
        changed = [f"{k}={v!r}" for k, v in self.values().items() if v != self.parameters()[k].default]
        return self.name + (f"({', '.join(changed)})" if changed else "")

    def __repr__(self) -> str:
        return f"<Stage {self.text}>"

    # -- what a method writes -------------------------------------------------------------------------------------

    def open(self, snapshot: Snapshot, progress: Progress) -> None:  # noqa: B027 - optional
        """Prepare for a snapshot; called again after its rows have changed."""

    def skip(self, frame: Frame) -> str | None:
        """Why this frame is not worth the stage's time, or None; must be cheap."""
        return None

    @abstractmethod
    def run(self, frame: Frame) -> None:
        """Do the work on one frame: hide, coarsen, replace, put products."""

    def close(self) -> None:  # noqa: B027 - optional
        """Release what `open` made."""


def parse_stages(text: str) -> list[tuple[str, dict[str, Any]]]:
    """Names and keyword values of a pipeline text such as ``frustum | shadow(active=15)``.

    Raises
    ------
    PipelineError
        Not of that form.
    """
    if not text.strip() or text.strip() == "none":
        return []
    try:
        tree = ast.parse(text.strip().replace("\n", " "), mode="eval").body
    except SyntaxError as error:
        raise PipelineError(
            f"cannot read {text!r} near column {error.offset}; write stages as name(key=value, ...) joined by |"
        ) from None
    parts: list[ast.expr] = []
    while isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.BitOr):
        parts.append(tree.right)
        tree = tree.left
    parts.append(tree)
    found: list[tuple[str, dict[str, Any]]] = []
    faults: list[str] = []
    for part in reversed(parts):
        call = part if isinstance(part, ast.Call) else None
        name = call.func if call else part
        if not isinstance(name, ast.Name):
            faults.append(f"{ast.unparse(part)!r} is not a stage; write name or name(key=value, ...)")
            continue
        values: dict[str, Any] = {}
        if call and call.args:
            faults.append(f"stage {name.id!r}: give parameters by name, as in {name.id}(key=value)")
        for item in call.keywords if call else ():
            try:
                values[str(item.arg)] = ast.literal_eval(item.value)
            except ValueError:
                # a bare word is what people type for a choice: ranking=marginal
                if isinstance(item.value, ast.Name):
                    values[str(item.arg)] = item.value.id
                else:
                    faults.append(f"stage {name.id!r}: the value of {item.arg} is not a number, text or truth value")
        found.append((name.id, values))
    if faults:
        raise PipelineError(faults)
    return found
