"""Which run a file is made of: marks that leave it readable."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from rpctl.errors import RpctlError
from rpctl.view.marks import ENDS, digest, mark_of, marked

RUN, OTHER = "0123456789abcdef" * 4, "f" * 64


def picture(kind: str) -> bytes:
    buffer = io.BytesIO()
    frames = [Image.new("RGB", (3, 2), colour) for colour in ("red", "blue")]
    more = {"save_all": True, "append_images": frames[1:]} if kind == "GIF" else {}
    frames[0].save(buffer, kind, **more)
    return buffer.getvalue()


def pdf() -> bytes:
    """Return what stands at the ends of every PDF."""
    return b"%PDF-1.4\n1 0 obj\n<<>>\nendobj\nstartxref\n0\n%%EOF\n"


def film() -> bytes:
    av = pytest.importorskip("av")
    import numpy as np

    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width = stream.height = 64
        container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8))))
        container.mux(stream.encode())
    return buffer.getvalue()


def pixels(data: bytes) -> list[bytes]:
    with Image.open(io.BytesIO(data)) as image:
        count = getattr(image, "n_frames", 1)
        frames = []
        for number in range(count):
            image.seek(number)
            frames.append(image.convert("RGB").tobytes())
        return frames


def frames(data: bytes) -> list[bytes]:
    av = pytest.importorskip("av")
    with av.open(io.BytesIO(data)) as container:
        return [frame.to_ndarray().tobytes() for frame in container.decode(video=0)]


FILES: dict[str, tuple[Callable[[], bytes], Callable[[bytes], object]]] = {
    ".png": (lambda: picture("PNG"), pixels),
    ".gif": (lambda: picture("GIF"), pixels),
    ".pdf": (pdf, lambda data: data.index(b"%%EOF") >= len(data) - 1024),
    ".mp4": (film, frames),
}


@pytest.mark.parametrize("suffix", FILES)
def test_a_mark_is_found_and_changes_nothing_else(suffix: str, tmp_path: Path) -> None:
    make, content = FILES[suffix]
    data, path = make(), tmp_path / f"a{suffix}"
    path.write_bytes(data)
    assert mark_of(path) is None
    path.write_bytes(marked(data, suffix.upper(), RUN))
    assert mark_of(path) == RUN
    assert content(path.read_bytes()) == content(data)
    assert marked(data, suffix, None) == data


def test_a_mark_is_found_at_either_end_of_a_long_file(tmp_path: Path) -> None:
    path, filling = tmp_path / "a.pdf", b" " * (2 * ENDS)
    path.write_bytes(marked(b"%PDF" + filling + b"%%EOF", ".pdf", RUN))
    assert mark_of(path) == RUN
    path.write_bytes(marked(picture("PNG"), ".png", OTHER) + filling)
    assert mark_of(path) == OTHER


@pytest.mark.parametrize(
    "text", ["rpctl-run:0123", f"rpctl-run {RUN}", f"rpctl-runs:{RUN}", RUN, ""]
)  # fmt: skip
def test_what_is_no_mark_is_none(text: str, tmp_path: Path) -> None:
    (tmp_path / "a").write_text(text)
    assert mark_of(tmp_path / "a") is None


def test_files_without_room_are_refused() -> None:
    with pytest.raises(RpctlError, match=r"\.svg does not keep which run"):
        marked(b"", ".svg", RUN)


def test_only_files_that_end_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.png")
    for read in (mark_of, digest):
        for path in (tmp_path / "a.png", tmp_path, Path("/dev/zero")):
            with pytest.raises(RpctlError, match=r"regular file|directory"):
                read(path)
