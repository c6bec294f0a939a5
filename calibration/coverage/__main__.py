"""Do the intervals hold the truth as often as they say?

python -m calibration.coverage            # 500 data sets a case
python -m calibration.coverage --sets 200 --seed 1 --case viscoelastic
python -m calibration.coverage --errors --sets 300      # errors that are shared, or unequal
"""

import argparse
from collections.abc import Sequence
from typing import Any

from calibration.coverage.batched import coverage_study
from calibration.coverage.cases import standard_cases
from calibration.coverage.experiments import experiments
from calibration.coverage.one_by_one import experiments_study
from calibration.coverage.table import Coverage, report
from calibration.errors import DataError, InputError, listed
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
    try:
        print(report(_studied(chosen)))
    except (DataError, InputError) as error:
        parser.error(str(error))
    return 0


def _studied(chosen: argparse.Namespace) -> list[Coverage]:
    if not chosen.errors:
        cases = _begun(standard_cases(), chosen.case)
        return coverage_study(cases, chosen.sets, chosen.seed)
    every = _begun(experiments(), chosen.case)
    with Progress() as progress:
        return experiments_study(every, chosen.sets, chosen.seed, progress=progress)


def _begun(cases: Sequence[Any], begin: str) -> list[Any]:
    """Those whose name begins so."""
    found = [case for case in cases if case.name.startswith(begin)]
    if not found:
        names = listed(dict.fromkeys(case.name.partition(",")[0] for case in cases))
        raise DataError("--case", begin, f"how the name of a case begins: {names}")
    return found


if __name__ == "__main__":
    raise SystemExit(main())
