"""Pictures at a constant rate as a file: H.264 in MP4, or an animated GIF."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpctl.errors import RpctlError

if TYPE_CHECKING:
    from PIL.Image import Image

QUALITY = "18"  # x264's constant rate factor: the eye sees no loss
BT709 = "colorprim=bt709:transfer=bt709:colormatrix=bt709"  # what players take HD video for
PALETTE_SAMPLES = 6  # pictures that give a GIF its palette
GIF_COLOURS = 256  # of a GIF
CENTISECONDS = 100  # in a second; a GIF counts in them
MAX_GIF_RATE_HZ = 50  # Hz; browsers slow down what is faster

TakePicture = Callable[[int], "Image"]
Encoder = Callable[[TakePicture, int, int, Callable[[int, int], None]], bytes]


def mp4(take: TakePicture, count: int, rate: int, progress: Callable[[int, int], None]) -> bytes:
    """Return pictures as an MP4 that every browser plays.

    Args:
        take: Returns a picture by its number; all are of one size, even both ways.
        count: How many there are.
        rate: Pictures a second.
        progress: Called with the number of pictures done and their total.

    Raises:
        RpctlError: PyAV is not installed.
    """
    try:
        import av
    except ImportError:
        raise RpctlError("films need more: pip install 'rpctl[film]'") from None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
            stream: Any = container.add_stream(
                "libx264", rate=rate, options={"crf": QUALITY, "x264-params": BT709}
            )
            stream.pix_fmt = "yuv420p"
            for number in range(count):
                picture = take(number)
                if not number:
                    stream.width, stream.height = picture.size
                shot = av.VideoFrame.from_ndarray(np.asarray(picture), format="rgb24")
                container.mux(stream.encode(shot.reformat(format="yuv420p", dst_colorspace=1)))
                progress(number + 1, count)
            container.mux(stream.encode())
        return path.read_bytes()


def gif(take: TakePicture, count: int, rate: int, progress: Callable[[int, int], None]) -> bytes:
    """Return pictures as a GIF that repeats for ever, all in one palette, so that nothing flickers.

    Args:
        take: Returns a picture by its number; a few are asked for twice.
        count: How many there are.
        rate: Pictures a second; 100 is a multiple of it.
        progress: Called with the number of pictures done and their total.
    """
    from PIL import Image

    chosen = np.unique(np.linspace(0, count - 1, PALETTE_SAMPLES).astype(int)).tolist()
    samples = np.concatenate([np.asarray(take(k)) for k in chosen])
    palette = Image.fromarray(samples).quantize(GIF_COLOURS, Image.Quantize.MEDIANCUT)

    def reduced() -> Iterator[Image.Image]:
        for number in range(count):
            yield take(number).quantize(palette=palette, dither=Image.Dither.NONE)
            progress(number + 1, count)

    first, *rest = reduced()
    buffer = io.BytesIO()
    delay = 1000 // rate  # ms
    first.save(buffer, "GIF", save_all=True, append_images=rest, duration=delay, loop=0)
    return buffer.getvalue()
