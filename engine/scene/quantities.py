"""The numbers, names and lists that scenes are made of, each with its bounds."""

from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Strict, Tag

T = TypeVar("T")


class Part(BaseModel):
    """Any part of a scene: immutable, no unknown keys, no text for numbers, no NaN or infinity."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=64)]
Text = Annotated[str, Field(max_length=4000)]

Length = Annotated[float, Field(ge=1e-9, le=1e6)]  # [m]
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]  # [m], also of accelerations [m/s^2]
Share = Annotated[float, Field(ge=0, le=1)]
Degrees = Annotated[float, Field(ge=-360, le=360)]
Seconds = Annotated[float, Field(ge=1e-9, le=1e6)]
Positive = Annotated[float, Field(gt=0, le=1e15)]
NotNegative = Annotated[float, Field(ge=0, le=1e15)]
Friction = Annotated[float, Field(ge=0, le=100)]  # Coulomb coefficient mu
Count = Annotated[int, Field(ge=1, le=1_000_000)]
Index = Annotated[int, Field(ge=0, le=1_000_000)]

# JSON has lists where immutable parts have tuples
Vector = Annotated[tuple[Coordinate, Coordinate, Coordinate], Strict(False)]
Place = Annotated[tuple[Coordinate, Coordinate], Strict(False)]
Extent = Annotated[tuple[Share, Share], Strict(False)]
Angles = Annotated[tuple[Degrees, Degrees, Degrees], Strict(False)]
Sizes = Annotated[tuple[Length, Length, Length], Strict(False)]
Triangle = Annotated[tuple[Index, Index, Index], Strict(False)]
Few = Annotated[tuple[T, ...], Strict(False), Field(max_length=64)]
Several = Annotated[tuple[T, ...], Strict(False), Field(max_length=1000)]
Many = Annotated[tuple[T, ...], Strict(False), Field(max_length=100_000)]


def _form(value: Any) -> str:
    return "list" if isinstance(value, list | tuple) else "single"


by_form = Discriminator(_form)  # tells a value from a list, so that only one of the two explains what is wrong
OneOrPair = Annotated[
    Annotated[T, Tag("single")] | Annotated[tuple[T, T], Strict(False), Tag("list")], by_form
]
