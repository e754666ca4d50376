"""Pictures in a row as a film: GIF by Pillow, MP4 by ffmpeg where that is installed."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable
from tempfile import TemporaryDirectory
from typing import BinaryIO

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

from maira_qp.apps.plots.style import COLORS
from maira_qp.errors import OptionError

NO_FFMPEG = "an animation in .mp4 needs ffmpeg, which is not on the PATH: install it, or name a .gif"


def check_ffmpeg() -> str:
    """Where ffmpeg is, as matplotlib's `animation.ffmpeg_path` names it. Raises `OptionError` if it is nowhere."""
    found = shutil.which(mpl.rcParams["animation.ffmpeg_path"])
    if found is None:
        raise OptionError(NO_FFMPEG)
    return found


def write_gif(file: BinaryIO, pictures: Iterable[np.ndarray], rate: float) -> None:
    """Pictures (height, width, 3) of uint8, so many a second, over and over."""
    palette = _palette()
    images = [Image.fromarray(each).quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    film = {"save_all": True, "append_images": images[1:], "duration": round(1000 / rate), "loop": 0, "optimize": True}
    images[0].save(file, format="GIF", **film)


def write_mp4(file: BinaryIO, pictures: Iterable[np.ndarray], rate: float) -> None:
    """Pictures (height, width, 3) of uint8, so many a second, once. Raises `OptionError` if ffmpeg is amiss."""
    ffmpeg = check_ffmpeg()
    frames = [np.ascontiguousarray(each[: len(each) // 2 * 2, : each.shape[1] // 2 * 2]) for each in pictures]
    height, width = frames[0].shape[:2]  # even, as H.264 wants them
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-"]
    with TemporaryDirectory() as folder:  # ffmpeg goes back to the beginning of the file, and so needs a name
        name = f"{folder}/film.mp4"
        command = [ffmpeg, "-loglevel", "error", "-y", *given, "-pix_fmt", "yuv420p", "-movflags", "+faststart", name]
        ran = subprocess.run(command, input=b"".join(each.tobytes() for each in frames), capture_output=True)
        if ran.returncode:
            words = ran.stderr.decode(errors="replace").split()
            raise OptionError(f"ffmpeg made no film: {' '.join(words) or ran.returncode}")
        with open(name, "rb") as film:
            shutil.copyfileobj(film, file)


def _palette() -> Image.Image:
    """The few colours of the film, each in steps towards white: a GIF stores them small, and all frames alike."""
    steps = dict.fromkeys(COLORS[:3], 8) | {"black": 40}  # fine greys: no wall may take on a tint
    shades = [np.linspace(to_rgb(color), (1.0, 1.0, 1.0), count) for color, count in steps.items()]
    palette = Image.new("P", (1, 1))
    palette.putpalette((255 * np.concatenate(shades)).round().astype(np.uint8).tobytes())
    return palette
