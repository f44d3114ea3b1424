"""``Certificate``: what was compared with what, how closely it agrees, and where it is worst."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from rpctl.equivalence.check import CONTACT_ORACLE, Check, Skipped

if TYPE_CHECKING:
    from rpctl.equivalence.contact.trial import ContactTrial
    from rpctl.equivalence.onset.trial import OnsetTrial


@dataclass(frozen=True)
class Certificate:
    """The outcome of :func:`rpctl.verify`: all checks of one robot.

    Attributes:
        robot: Its name.
        samples: Number of random states.
        seed: Their seed.
        checks: The comparisons; each with its worst state.
        skipped: Comparisons that were not made.
        estimated_links: Links whose mass and inertia are estimates: the equations are right for
            them, they need not be right for the robot.
        declared: How far the user's own numbers are from the file's shapes; neither passed nor
            failed.
        shared: What no derivation found for itself, in phrases.
        idealised: What the model leaves out of the file, or takes for simpler, in sentences; no
            comparison here can tell.
        contact: The trial on the ground, where it was asked for and could be made.
        onset: The trial of slip and tipping predictions, where it was asked for and could be made.
        loaded_with: The arguments with which :func:`rpctl.load` gives this robot.
    """

    robot: str
    samples: int
    seed: int
    checks: tuple[Check, ...]
    skipped: tuple[Skipped, ...] = ()
    estimated_links: tuple[str, ...] = ()
    declared: tuple[Check, ...] = ()
    shared: tuple[str, ...] = ()
    idealised: tuple[str, ...] = ()
    contact: ContactTrial | None = None
    onset: OnsetTrial | None = None
    loaded_with: Mapping[str, Any] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every comparison that was made passed."""
        trials = [trial for trial in (self.contact, self.onset) if trial is not None]
        return all(trial.passed for trial in trials) and all(check.passed for check in self.checks)

    def strict(self) -> Certificate:
        """Return it with the declared numbers among the checks: they fail where shapes differ."""
        return replace(self, checks=(*self.checks, *self.declared), declared=())

    @property
    def notes(self) -> list[tuple[str, str]]:
        """What else there is to say, each with the name of the other side."""
        remarks = [(c.against, c.note) for c in (*self.checks, *self.declared) if c.note]
        if self.contact is not None:
            remarks += [(CONTACT_ORACLE, note) for note in self.contact.notes]
        return remarks

    @property
    def worst(self) -> Check:
        """The check nearest to its limit, or furthest beyond it."""
        return max(self.checks, key=lambda check: check.limit_ratio)

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain values for JSON; an infinite residual is None."""
        return {
            "robot": self.robot,
            "passed": self.passed,
            "samples": self.samples,
            "seed": self.seed,
            "checks": [check.to_dict() for check in self.checks],
            "skipped": [asdict(each) for each in self.skipped],
            "estimated_links": list(self.estimated_links),
            "declared": [check.to_dict() for check in self.declared],
            "shared": list(self.shared),
            "idealised": list(self.idealised),
            "contact": None if self.contact is None else self.contact.to_dict(),
            "onset": None if self.onset is None else self.onset.to_dict(),
            "loaded_with": dict(self.loaded_with),
        }
