"""Descriptions in xacro, expanded by the `xacro` package. The format: https://wiki.ros.org/xacro."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maira_qp.errors import OptionError, RobotError, shown
from maira_qp.regular_files import read_regular
from maira_qp.robots.urdf.safe_xml import MAX_BYTES, is_text

SUFFIX = ".xacro"


def is_xacro(source: Any) -> bool:
    """Whether a description is the path of a xacro file."""
    return isinstance(source, (str, os.PathLike)) and not is_text(source) and Path(source).suffix.lower() == SUFFIX


def expanded(source: str | os.PathLike[str], arguments: Mapping[str, Any] | None) -> str:
    """URDF text from a xacro file and values of its arguments (`<xacro:arg>`), as text or as Python's numbers.

    Raises `OptionError` for arguments that are no mapping of names; `RobotError` if the `xacro` package is missing, for
    a file that cannot be read, and for what xacro refuses.
    """
    if not isinstance(arguments, (Mapping, type(None))) or not all(isinstance(key, str) for key in arguments or {}):
        raise OptionError(f"xacro_args must be a mapping {{argument: value}}, got {shown(arguments)}")
    read_regular(source, "the robot description", RobotError, MAX_BYTES)  # what is no such file is not left to xacro
    try:
        xacro = importlib.import_module("xacro")
    except ImportError:
        raise RobotError(
            f"{Path(source).name} is xacro, and the package that expands it is not installed: pip install "
            "'maira-qp[xacro]'; or run `xacro in.xacro > out.urdf` where it is"
        ) from None
    mappings = {key: value if isinstance(value, str) else str(value) for key, value in (arguments or {}).items()}
    try:
        return xacro.process_file(os.fspath(source), mappings=mappings).documentElement.toxml()
    except Exception as reason:  # xacro evaluates expressions of Python: anything can come out
        told = " ".join(str(reason).split()) or type(reason).__name__
        raise RobotError(f"xacro cannot expand {Path(source).name}: {told:.500}") from None
