"""What several tests of commands share."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rpctl.view import run_folder


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write files in place of page and picture, which take longer than a short run."""
    page = b"page", SimpleNamespace(notes=())
    monkeypatch.setattr(run_folder, "sized_report", lambda *_: page)
    monkeypatch.setattr(run_folder, "tracking_image", lambda _: b"picture")
