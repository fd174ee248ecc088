"""What the evidence says of the wear laws, in words and in a table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scipy.special import chdtrc

from isochrome.fitting.frame.unknowns import WEAR
from isochrome.fitting.wear_laws.law_evidence import CLEAR, LawFit

_UNLIKELY = 1e-4
"""Chance of a law's misfit below which the frames speak against it."""

_BY_FRICTION = {"archard", "sarkar", "dissipated_energy"}
"""Laws that differ only by how they take friction in."""


@dataclass(frozen=True)
class WearLaws:
    """The wear laws compared.

    `laws`, by falling evidence; `between`, the mean coefficient from the last frame's distance to
    a frame's own, {from_m, to_m, value, standard_uncertainty}, mm²/N; `chi`, residual over noise
    with these.
    """

    laws: tuple[LawFit, ...]
    between: tuple[dict[str, float], ...]
    chi: float

    @property
    def close(self) -> tuple[LawFit, ...]:
        """The preferred law, and those that the frames do not tell from it."""
        return tuple(law for law in self.laws if law.log_evidence > -CLEAR)

    @property
    def none_fits(self) -> bool:
        """Whether even the preferred law misses what was worn by far more than its uncertainty."""
        best = self.laws[0]
        return best.freedom > 0 and float(chdtrc(best.freedom, best.misfit)) < _UNLIKELY

    def sentence(self) -> str:
        """Which law the frames prefer, and by how much, or that they cannot tell."""
        names = [law.law for law in self.close]
        if len(names) > 1:
            listed = f"{', '.join(names[:-1])} and {names[-1]}"
            text = f"the frames cannot tell {listed} apart (ln Z within {CLEAR:g})"
            if len(_BY_FRICTION & set(names)) > 1:
                text += (
                    "; laws that differ by friction alone are alike where it changes little: "
                    "their coefficients make up for it"
                )
        else:
            margin = -self.laws[1].log_evidence
            text = (
                f"the frames prefer {names[0]}, by a margin of {margin:.3g} in ln Z over "
                f"{self.laws[1].law} ({CLEAR:g} is clear)"
            )
        if self.none_fits:
            best = self.laws[0]
            text += (
                f"; yet {best.law} leaves a misfit of {best.misfit:.3g} variances where "
                f"{best.freedom} are expected: something else wears too"
            )
        return text

    def speaks_against(self, law: str) -> bool:
        """Whether a law is behind the preferred one by a clear margin; not if none weighed it."""
        return any(one.law == law and one.log_evidence <= -CLEAR for one in self.laws)

    def to_json(self) -> list[dict[str, Any]]:
        """A dictionary for each law, its parameters among its keys."""
        return [
            {
                "law": law.law,
                "chi": law.chi,
                "log_evidence": law.log_evidence,
                "misfit": law.misfit,
                "degrees_of_freedom": law.freedom,
                "between": list(law.between),
                **{name.removeprefix("wear."): found for name, found in law.parameters.items()},
            }
            for law in self.laws
        ]

    def table(self) -> dict[str, list[Any]]:
        """The columns of wear_laws.csv."""
        rows = self.to_json()
        names = ("law", "log_evidence", "chi", "misfit", "degrees_of_freedom")
        wear = [law.parameters[WEAR] for law in self.laws]
        return {name: [row[name] for row in rows] for name in names} | {
            "coefficient_mm2_per_n": [item["value"] for item in wear],
            "standard_uncertainty": [item["standard_uncertainty"] for item in wear],
        }
