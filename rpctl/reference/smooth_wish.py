"""What a user may ask of smoothing; it loads nothing heavy."""

from __future__ import annotations

from rpctl.errors import RpctlError, require_positive

AUTO = "auto"  # the tolerance that cross-validation chooses


def require_smoothing(wish: float | str | None) -> None:
    """Refuse what is no tolerance of smoothing.

    Raises:
        RpctlError: It is neither a positive number nor ``auto``.
    """
    if isinstance(wish, str):
        if wish != AUTO:
            raise RpctlError(f'smooth is "{wish}"; give metres, as 0.01, or {AUTO}')
    elif wish is not None:
        require_positive("smooth", wish)


def read_smoothing(text: str | None) -> float | str | None:
    """Return the tolerance that ``METRES|auto`` names.

    Raises:
        RpctlError: It is neither.
    """
    try:
        return text if text in (None, AUTO) else float(text)
    except ValueError:
        raise RpctlError(f"--smooth {text}: give metres, as 0.01, or {AUTO}") from None
