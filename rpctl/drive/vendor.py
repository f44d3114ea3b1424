"""What plugins and controllers say of the wheels, compared with what the geometry gives."""

from __future__ import annotations

from collections.abc import Iterator

from rpctl.drive.drive import Drive
from rpctl.drive.plugins import PLANAR, BaseControl, SimulatorTags
from rpctl.errors import Finding

MAX_DIFFERENCE = 0.01  # of a length; files round
KINDS_OF = {  # drives that a plugin or controller of a kind can move
    "differential": ("differential", "skid-steer"),
    "skid-steer": ("differential", "skid-steer"),
    "mecanum": ("mecanum",),
    "omni": ("omni", "mecanum"),
    "car-like": ("car-like", "tricycle", "bicycle", "steered"),
    "tricycle": ("tricycle", "bicycle", "car-like"),
}


def vendor_findings(drive: Drive, tags: SimulatorTags) -> tuple[Finding, ...]:
    """Return where plugins and controllers differ from a drive's geometry, in findings.

    A differing kind or radius is a warning: one of the two is wrong. The separation of the wheels
    is the odometry's, which vendors tune for skid-steer drives: there it is a remark, and the way
    to take theirs.

    Args:
        drive: The drive, as the geometry has it.
        tags: What the file tells simulators and controllers.
    """
    if drive.type == "fixed" or "drive" in drive.declared:
        return ()
    found = [finding for control in tags.controls for finding in _compare(drive, control)]
    return tuple(dict.fromkeys(found))


def _compare(drive: Drive, control: BaseControl) -> Iterator[Finding]:
    """Yield where a plugin or a controller differs from a drive."""
    if control.kind == PLANAR:
        return
    if drive.type not in KINDS_OF[control.kind]:
        yield Finding(
            "warning",
            control.line,
            f"{control.label} is made for {control.kind} drives, and the wheels make a "
            f"{drive.type} drive; say which it is with --drive",
        )
        return
    rolling = [w for w in drive.wheels if w.driven and not w.slides]
    named = [w for w in rolling if w.joint in control.joints] or rolling
    if control.radius is not None and named:
        theirs = control.radius * control.radius_multiplier
        ours = named[0].radius
        if _differ(theirs, ours):
            yield Finding(
                "warning",
                control.line,
                f"{control.label} has wheels of radius {theirs:.4g} m"
                f"{_factor(control.radius, control.radius_multiplier)}, where "
                f'"{named[0].joint}" has {ours:.4g} m ({named[0].source}); the latter is taken, '
                "a drive file gives another",
            )
    yield from _compare_separation(drive, control)


def _compare_separation(drive: Drive, control: BaseControl) -> Iterator[Finding]:
    """Yield that the wheels are not as far apart as a plugin or a controller has it."""
    own = drive.track if control.separation is None else control.separation
    theirs = own * control.separation_multiplier
    if drive.type not in ("differential", "skid-steer") or not _differ(theirs, drive.track):
        return
    how = _factor(own, control.separation_multiplier)
    skids = drive.type == "skid-steer"
    fix = f"a drive file with track = {theirs:.4g} takes theirs" if skids else "correct one of them"
    yield Finding(
        "info" if skids else "warning",
        control.line,
        f"{control.label} has the wheels {theirs:.4g} m apart{how}, the geometry {drive.track:.4g} "
        f"m, which is taken; {fix}",
    )


def _differ(theirs: float, ours: float) -> bool:
    return abs(theirs - ours) > MAX_DIFFERENCE * ours


def _factor(length: float, multiplier: float) -> str:
    return "" if multiplier == 1.0 else f" ({length:.4g} times its multiplier {multiplier:.4g})"
