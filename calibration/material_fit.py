"""The fit of one data set: its parameters, its law, how closely the law follows."""

import math
from dataclasses import dataclass

import numpy as np

import softjax as sj
from calibration.data.measurements import RestitutionData
from calibration.doubt import Doubt
from calibration.estimate import Estimate
from calibration.parameters import CONTACT_COLUMNS


@dataclass(frozen=True)
class MaterialFit:
    """The fit of one data set.

    Attributes:
        data: the measurements.
        plan: its objective.
        parameters: estimates by name, the fixed ones too.
        derived: eps_up, critical_velocity [m/s] and the like.
        columns: the physical values that make the curve.
        rms, rms_empirical: of the fitted curve, and of Eq. (17), against the data.
        reduced_chi_squared: with the stated uncertainties; None without.
        status: `softjax.Status` at each point.
        warnings: the doubts about this data set.
    """

    data: RestitutionData
    plan: str
    parameters: dict[str, Estimate]
    derived: dict[str, Estimate]
    columns: dict[str, float]
    rms: float
    rms_empirical: float | None
    reduced_chi_squared: float | None
    converged: bool
    status: tuple[int, ...]
    warnings: tuple[Doubt, ...]
    form: str
    kappa: str

    @property
    def name(self) -> str:
        return self.data.name

    @property
    def n(self) -> int:
        return len(self.data)

    @property
    def contact(self) -> sj.Contact | None:
        """The two bodies with what was fitted of them."""
        if self.data.contact is None:
            return None
        leaves = dict(self.data.contact.leaves())
        for name in CONTACT_COLUMNS:
            if name in self.parameters:
                leaves[name] = self.columns[name]
        return sj.Contact(**leaves, area=self.data.contact.area)

    @property
    def law(self) -> sj.ContactLaw | None:
        """The fitted law; None without elastic properties.

        Where ε_up was fitted in place of σ and ψ, ψ is a guess from the data and σ such that
        Eq. (17) gives ε_up at v_cr: above yield the law is the fitted one, below it is not known.
        """
        contact = self.contact
        if contact is None or self.plan not in ("two-step", "model"):
            return None
        sigma, psi = self.columns["sigma"], self.columns["psi"]
        if "eps_up" in self.parameters:
            critical = np.mean(np.asarray(contact.critical_velocity))
            ratio = critical / (np.mean(np.asarray(contact.limit_velocity)) - critical)
            sigma = -math.log(self.columns["eps_up"]) / float(ratio) ** psi
        return sj.Zhou(contact, self.columns["chi"], sigma, psi, self.form, self.kappa)
