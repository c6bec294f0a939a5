"""Do the intervals hold the truth as often as they say?

python -m calibration.coverage            # 500 data sets a case
python -m calibration.coverage --sets 200 --seed 1 --case viscoelastic
python -m calibration.coverage --errors --sets 300      # errors that are shared, or unequal
"""

import argparse
from collections.abc import Sequence

from calibration.coverage.batched import coverage_study
from calibration.coverage.cases import standard_cases
from calibration.coverage.experiments import experiments
from calibration.coverage.one_by_one import experiments_study
from calibration.coverage.table import report
from calibration.progress import Progress


def main(arguments: Sequence[str] | None = None) -> int:
    """The documented command."""
    parser = argparse.ArgumentParser(
        prog="python -m calibration.coverage", description=__doc__.split("\n")[0]
    )
    parser.add_argument("--sets", type=int, default=500, help="simulated data sets a case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--case", default="", help="only those whose name begins so")
    parser.add_argument("--errors", action="store_true", help="errors as laboratories have them")
    chosen = parser.parse_args(arguments)
    begins = lambda case: case.name.startswith(chosen.case)  # noqa: E731
    if chosen.errors:
        every = list(filter(begins, experiments()))
        with Progress() as progress:
            study = experiments_study(every, chosen.sets, chosen.seed, progress=progress)
        print(report(study))
    else:
        cases = list(filter(begins, standard_cases()))
        print(report(coverage_study(cases, chosen.sets, chosen.seed)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
