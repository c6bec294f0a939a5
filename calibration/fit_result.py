"""Fit a law's parameters to measured restitutions: `fit`, and the `FitResult` that it returns."""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax

import softjax as sj
from calibration.console import progress_of
from calibration.data import RestitutionData
from calibration.errors import DataError
from calibration.fitting.estimates import FitEstimates
from calibration.fitting.request import Request, datasets_of
from calibration.fitting.run import Progress, run
from calibration.options import FitOptions, documented, merged


class FitResult(FitEstimates):
    """A fit; prints itself as a table. See `MaterialFit` for one data set of it.

    Attributes:
        request: data, parameters and options.
        materials: one `MaterialFit` a data set.
        unloading_line: Eq. (18) through several materials of Zhou's law, or None.
        covariance_names, covariance: of the free parameters, in physical units, with the part of
            uncertain inputs.
        statistical_covariance: that without it.
        of_predictions: the covariance with 0 along what is undetermined: of what follows from the
            parameters together.
        rank, condition_number: of the weighted Jacobian with columns scaled to one.
        likelihood: None under `two-step`, for pooled parameters, and for data without noise.
        warnings: all of them.
        optimiser_report: what each stage took.
        profiles: by parameter label.
        dof_by_component: how well the noise is known that the covariance comes from, of each component.
        pooled: mean and spread of parameters that are pooled, "chi" and "chi_spread"; the spread on
            the scale that is searched, ln θ where θ is positive.
        settings, versions, times: how, with what, how long [s].
        budget: what uncertain inputs add; None where none is stated.
        of_one_per_cent: where none is stated, by name of an input, the changes of results [%] where it is
            1 % larger, to first order; of up to `FEW_SETS` data sets.
        fits: the searches themselves; None in a result that was loaded.
    """

    def to_frame(self) -> Any:
        """All estimates as a pandas DataFrame, one a row; see `calibration.report.tables`."""
        from calibration.report.tables import estimates

        return estimates(self)

    def to_markdown(self) -> str:
        """The table of parameters in Markdown: value ± standard error, and interval."""
        from calibration.report.papers import markdown

        return markdown(self)

    def to_latex(self) -> str:
        r"""The table of parameters as LaTeX's tabular (package booktabs): $\tilde\chi$, $1.794 \pm 0.052$."""
        from calibration.report.papers import latex

        return latex(self)

    def report(self, folder: str | Path) -> list[str]:
        """Write what `softjax fit` writes into a folder: fit.json, pictures, report.html.

        Returns:
            The names of the files.

        Raises:
            OSError: where they cannot be written; none of them is then.
        """
        from calibration import output
        from calibration.report.fit import write_report

        output.lost.clear()
        names = write_report(self, folder)
        for picture, reason in output.lost.items():
            warnings.warn(f"{picture} could not be drawn ({reason})", stacklevel=2)
        return names

    def plot(
        self,
        ax: Any = None,
        figsize: tuple[float, float] | None = None,
        log: bool = False,
        laws: Mapping[str, sj.ContactLaw] | None = None,
        points: Any = None,
    ) -> Any:
        """Draw data, fitted curves with their bands, and residuals below.

            upper, lower = result.plot(figsize=(3.35, 3.6), log=True)      # 85 mm wide
            upper.figure.savefig("fit.pdf")

        Args:
            ax: Matplotlib's axes to draw into: one for ε, or two with the residuals; of one data set.
            figsize: width and height of a figure of its own [inches].
            log: a logarithmic axis of velocity; without it where the data span more than 1.5 decades.
            laws: further laws, {label: law}, dashed.
            points: False leaves the data out; `RestitutionData` are drawn, too.

        Returns:
            The axes: those given; else two, of several data sets one row of two for each.
        """
        from calibration.plots import plot

        return plot(self, ax, figsize, log, laws, points)

    def _repr_html_(self) -> str:
        from calibration.report.fit import result_html

        return result_html(self)

    def __str__(self) -> str:
        from calibration.report.fit import result_text

        return result_text(self)

    __repr__ = __str__


@documented
def fit(
    data: RestitutionData | Sequence[RestitutionData] | str | Path,
    law: str | type | Callable[..., sj.ContactLaw] | None = None,
    parameters: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    *,
    inputs: Mapping[str, Any] | None = None,
    progress: Progress | bool | None = None,
    **options: Any,
) -> FitResult:
    """Fit a contact law to one data set or several.

    Args:
        data: one `RestitutionData`, or a list of them with different names; or the path of a material
            file, "my.toml", whose `[fit]` and parameters then act as in `softjax fit my.toml`: options
            given here win, and `parameters` take the place of the file's.
        law: Zhou's where left out (for data without a contact Eq. (17), or a constant); a name of
            `LAWS`, a class of contact laws, or any function that builds one: law(contact, c1, c2).
        parameters: the parameters of the law: {"chi": ...} for all data sets,
            {"chi[name]": ...} for one; a `Parameter`, a number that fixes it, or a text for an
            option such as {"form": "full"}; or a list of such mappings, one a data set. Those of
            the contact are "contact.yield_strength" and so on. All of a law's own are free, except
            what ε does not determine.
        inputs: standard uncertainties of numbers that all points have in common, {"youngs_modulus":
            5e9, "wall.yield_strength": "10 %"}, in SI or as text, for one set {name: {...}}, in addition
            to those that a file states: see `calibration.data.inputs`. They enter standard errors,
            intervals and bands (`FitResult.budget`), not the likelihood.
        progress: True shows it, a bar on a terminal and else a line a stage; or a function that is
            called as progress(stage, done, total).
        OPTIONS

    Returns:
        A `FitResult`. A fit that did not converge is marked so, not raised.

    Data sets that share no parameter are fitted each by itself. All is computed in float64, whatever
    JAX is set to.

    Raises:
        ValueError: naming the argument, its value and what is accepted.

    Example:
        >>> import calibration as cal
        >>> steel = cal.paper_materials()[0]
        >>> result = cal.fit(steel, objective="two-step")
        >>> round(result.values["chi"], 4)
        1.7944
    """
    started = time.perf_counter()
    with progress_of(progress) as shown, jax.enable_x64(True):
        if isinstance(data, str | Path):
            data, law, parameters, options = _of_file(data, law, parameters, options)
        options_of_fit = FitOptions.of(law=law, **options)
        if not (shown is None or callable(shown)):
            accepted = "True, or called as progress(stage, done, total)"
            raise DataError("progress", shown, accepted)
        request = Request(datasets_of(data), parameters, options_of_fit)
        result = run(request, inputs, shown or (lambda *_: None), FitResult)
    result.times["total"] = time.perf_counter() - started
    return result


def _of_file(path: str | Path, law: Any, parameters: Any, options: dict[str, Any]) -> tuple:
    """Data, law, parameters and options of a material file, with those that were given in place of its own."""
    from calibration.data.materials import read_problem

    file = read_problem(path)
    stated = {
        name: x for name, x in file.settings.items() if name != "area"
    }  # the contacts have it
    settings = merged(stated, options if law is None else {"law": law, **options})
    data = file.datasets[0] if len(file.datasets) == 1 else file.datasets
    law = settings.pop("law", None)
    return data, law, file.parameters if parameters is None else parameters, settings
