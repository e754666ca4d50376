"""Lists of numbers as flags: `--position -0.4 0 0.5`."""

from __future__ import annotations

from typing import Annotated

from tyro.constructors import PrimitiveConstructorSpec

from maira_qp.apps.arguments.optional import UNSAID


def _numbers(count: int | str, metavar: str) -> PrimitiveConstructorSpec:
    """How tyro reads so many numbers ("*": any) or leaves them None."""
    return PrimitiveConstructorSpec(
        nargs=count,  # type: ignore[arg-type]
        metavar=metavar,
        instance_from_str=lambda words: tuple(float(word) for word in words),
        is_instance=lambda value: value is None or isinstance(value, tuple),
        str_from_instance=lambda value: ["none"] if value is None else [repr(number) for number in value],
    )


Position = Annotated[tuple[float, ...] | None, _numbers(3, "X Y Z"), UNSAID]
Quaternion = Annotated[tuple[float, ...] | None, _numbers(4, "W X Y Z"), UNSAID]
Rpy = Annotated[tuple[float, ...] | None, _numbers(3, "ROLL PITCH YAW"), UNSAID]
ToolPose = Annotated[tuple[float, ...] | None, _numbers("*", "X Y Z ..."), UNSAID]
JointValues = Annotated[tuple[float, ...] | None, _numbers("*", "Q1 Q2 ..."), UNSAID]
Range = Annotated[tuple[float, ...] | None, _numbers("*", "LOWER UPPER"), UNSAID]
