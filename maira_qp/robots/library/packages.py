"""Where packages that carry robot descriptions keep them. Nothing is downloaded."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

from maira_qp.errors import RobotError, listed
from maira_qp.robots.library.names import DESCRIPTIONS, ENTRIES, EXAMPLES, OWN, TOOLBOX, Entry
from maira_qp.robots.urdf.safe_xml import xml_root


def description_file(entry: Entry) -> Path:
    """The file that describes a robot, URDF or MJCF. Raises `RobotError`, with what to do, where it is not there."""
    if entry.package == DESCRIPTIONS:
        return _of_descriptions(entry.name)
    folder = _FOLDERS[entry.package]()
    if folder is None:
        raise RobotError(
            f"the robot {entry.qualified!r} is in a package that is not installed: pip install {entry.package}"
        )
    path = folder / entry.path
    if not path.is_file():
        raise RobotError(f"the package {entry.package} that is installed has no {entry.path}")
    return path


def srdf_beside(path: Path, *names: str) -> Path | None:
    """The SRDF that belongs to a description, if there is one in its folder or in the folder `srdf` beside that.

    It is the file that is called by the first of the robot's `names` for which there is one, else the only one of whose
    robot that is the name.
    """
    folders = (path.parent, path.parent.parent / "srdf")
    files = sorted(file for folder in folders for file in folder.glob("*.srdf"))
    called = [file for name in names for file in files if file.stem == name]
    told = called or [file for file in files if _robot_name(file) in names]
    return told[0] if called or len(told) == 1 else None


def _robot_name(srdf: Path) -> str | None:
    """The robot's name in an SRDF; None where it is no XML."""
    try:
        return xml_root(srdf).get("name")
    except RobotError:
        return None


def installed() -> tuple[Entry, ...]:
    """The robots that can be loaded by name, without those of `robot_descriptions`."""
    there = {package for package, folder in _FOLDERS.items() if folder() is not None}
    return tuple(entry for entry in ENTRIES if entry.package == OWN or entry.package in there)


def _examples() -> Path | None:
    try:
        folder = Path(str(distribution(EXAMPLES).locate_file("cmeel.prefix/share/example-robot-data/robots")))
    except PackageNotFoundError:
        return None
    return folder if folder.is_dir() else None


def _toolbox() -> Path | None:
    spec = find_spec("rtbdata")
    folders = () if spec is None else spec.submodule_search_locations or ()
    return next((Path(folder) / "xacro" for folder in folders), None)


_FOLDERS: dict[str, Callable[[], Path | None]] = {EXAMPLES: _examples, TOOLBOX: _toolbox}


def _of_descriptions(name: str) -> Path:
    """The file of a module of `robot_descriptions`, if the repository that it is in has been downloaded before."""
    if find_spec(DESCRIPTIONS) is None:
        raise RobotError(f"the robot {name!r} is in a package that is not installed: pip install {DESCRIPTIONS}")
    known = importlib.import_module(f"{DESCRIPTIONS}._descriptions").DESCRIPTIONS
    if name not in known:
        raise RobotError(f"{DESCRIPTIONS} has no {name!r}; {listed(known, name, limit=8)}")
    if not _is_downloaded(getattr(known[name], "repository", None)):
        raise RobotError(
            f"the files of {name!r} are not on this machine, and are not downloaded unasked: "
            f"python -m robot_descriptions pull {name}"
        )
    module: ModuleType = importlib.import_module(f"{DESCRIPTIONS}.{name}")
    path = getattr(module, "URDF_PATH", None) or getattr(module, "MJCF_PATH", None)
    if path is None:
        raise RobotError(f"{name!r} is described by xacro: give its XACRO_PATH to Robot.from_urdf")
    return Path(path)


def _is_downloaded(repository: str | None) -> bool:
    """Whether a repository of `robot_descriptions` is in its cache at the commit that is wanted."""
    wanted = importlib.import_module(f"{DESCRIPTIONS}._repositories").REPOSITORIES.get(repository)
    if wanted is None or os.getenv("ROBOT_DESCRIPTION_COMMIT"):
        return False
    cache = Path(os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")).expanduser()
    git = cache / wanted.cache_path / ".git"
    try:
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        tag = git / "refs" / "tags" / wanted.commit
        return head == (tag.read_text(encoding="utf-8").strip() if tag.is_file() else wanted.commit)
    except OSError:
        return False
