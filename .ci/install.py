"""Install a wheel as a user does, without extras, into a new environment; use it; uninstall it again.

    python .ci/install.py 3.12 WHEEL      # on Python 3.12, with the newest versions of what it needs
    python .ci/install.py lowest WHEEL    # on the oldest Python that is found, with the lowest versions that
                                          # pyproject.toml allows

The library and the command must work there, from an empty cache of compiled code, and `pip uninstall` may leave only
that cache. Python is looked for on PATH, and among those that pyenv has; where there is none, a line says so, and
nothing fails. uv installs what the wheel needs, in a second where pip takes half a minute; beside the lowest versions,
pip installs and uninstalls the wheel.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import distributions
from pathlib import Path

ROOT = Path(__file__).parents[1]
SUPPORTED = ("3.10", "3.11", "3.12", "3.13")
LOWEST = ["--resolution", "lowest-direct", "--only-binary", ":all:", "--constraints", ROOT / ".ci" / "oldest.txt"]
"""oldest.txt: Pinocchio 3.4.0 does not say itself which versions of its libraries it was built for."""

USE = """
import maira_qp as mq

robot = mq.Robot.maira()
target = mq.pose([0.4, 0.2, 0.9], quaternion=[0, 1, 0, 0])
strict = mq.Solver(robot, redundancy=mq.Strict(mq.Posture())).solve(target)
weighted = mq.Solver(robot, redundancy=mq.Weighted(mq.Posture(), fading=True)).solve(target)
assert strict.success and weighted.success, (strict, weighted)
print(mq.__version__)
"""


def find_python(version: str) -> str | None:
    """Return an interpreter of a version such as 3.12: the first on PATH that runs, else pyenv's newest, else None."""
    candidates = [shutil.which(f"python{version}", path=folder) for folder in os.get_exec_path()]
    if shutil.which("pyenv"):  # what it puts on PATH runs only versions that `pyenv global` has chosen
        prefix = subprocess.run(["pyenv", "prefix", version], capture_output=True, text=True).stdout.strip()
        candidates.append(shutil.which("python", path=f"{prefix}/bin"))
    for each in filter(None, candidates):
        ran = subprocess.run([each, "--version"], capture_output=True, text=True)
        if ran.returncode == 0 and ran.stdout.startswith(f"Python {version}."):
            return each
    return None


def run(*command: object, **settings) -> str:
    """Return what a command prints; if it fails, print all that it said and exit."""
    words = [str(word) for word in command]
    ran = subprocess.run(words, capture_output=True, text=True, **settings)
    if ran.returncode != 0:
        sys.exit(f"{' '.join(words)}\n{ran.stdout}{ran.stderr}")
    return ran.stdout


def installed_files(folder: Path) -> set[Path]:
    """Return all files of a folder, without bytecode."""
    return {path for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc"}


def check_floors(packages: Path) -> None:
    """Exit with a message if a lowest version of pyproject.toml is not what was installed, since it cannot be."""
    versions = {each.name.lower(): each.version for each in distributions(path=[str(packages)])}
    (wheel,) = distributions(name="maira-qp", path=[str(packages)])
    for need in wheel.requires or []:
        floor = re.match(r"([\w-]+)>=([\d.]+)", need)
        version = versions.get(floor[1].lower()) if floor and "extra ==" not in need else None  # None: others need it
        if version is not None and not f"{version}.".startswith(f"{floor[2]}."):
            sys.exit(f"{need} in pyproject.toml: the lowest that can be installed is {version}")


def main(which: str, wheel: str) -> None:
    """Install, use and uninstall the wheel; print how it went."""
    versions = SUPPORTED if which == "lowest" else (which,)
    python = next(filter(None, map(find_python, versions)), None)
    if python is None:
        print(f"not tested: Python {' or '.join(versions)}, not found here")
        return
    with tempfile.TemporaryDirectory() as folder:
        venv, home = Path(folder) / "venv", Path(folder) / "home"
        home.mkdir()
        run(python, "-m", "venv", "--without-pip", venv)
        there = {"env": {**os.environ, "UV_PYTHON": f"{venv}/bin/python", "PIP_PYTHON": f"{venv}/bin/python"}}
        uv, pip = [sys.executable, "-m", "uv", "pip"], [sys.executable, "-m", "pip"]
        lowest, installer = (LOWEST, pip) if which == "lowest" else ([], uv)
        run(*uv, "install", *lowest, "--requirements", ROOT / "pyproject.toml", **there)
        before = installed_files(venv)
        run(*installer, "install", "--no-deps", wheel, **there)
        run(*uv, "check", **there)
        if which == "lowest":
            check_floors(next(venv.glob("lib/*/site-packages")))
        user = {"env": {"HOME": str(home), "PATH": f"{venv}/bin:/usr/bin:/bin", "OMP_NUM_THREADS": "1"}, "cwd": home}
        run(venv / "bin" / "maira-qp", "doctor", **user)
        run(venv / "bin" / "maira-qp", "solve", "--position", "0.4", "0.2", "0.9", **user)
        version = run(venv / "bin" / "python", "-c", USE, **user).strip()
        run(*installer, "uninstall", "--yes", "maira-qp", **there)
        left = installed_files(venv) - before | installed_files(home) - installed_files(home / ".cache" / "maira_qp")
        if left:
            sys.exit(f"uninstalling leaves {', '.join(map(str, sorted(left)))}")
    print(f"maira_qp {version} installs, works and uninstalls: Python {python}, {which}")


if __name__ == "__main__":
    main(*sys.argv[1:])
