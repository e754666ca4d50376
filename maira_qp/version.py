"""The version of this package, as it was installed."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("maira-qp")
except PackageNotFoundError:  # imported from a folder, and not installed
    __version__ = "0.0.0"
