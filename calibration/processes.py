"""Several processes at one command: started by `mpirun`, by SLURM, or by hand.

    softjax curve … --coordinator localhost:1234 --process 0 --processes 2      # and --process 1

Without these options they are what JAX finds by itself, where Open MPI or SLURM started more than
one process. Which process this is, of how many, MPICH too tells beside --coordinator.
"""

import argparse
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from calibration.errors import DataError, InputError

if TYPE_CHECKING:
    from calibration.parts import Parts

FOLDER = "parts"
# what tells a process its place, of whoever started it: which one, of how many
LAUNCHERS = (
    ("OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"),
    ("SLURM_PROCID", "SLURM_STEP_NUM_TASKS"),  # of a step: a batch script alone is one process
    ("PMI_RANK", "PMI_SIZE"),
)
WAIT = 300  # s for all to come


def add_process_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("several processes")
    group.add_argument("--coordinator", metavar="HOST:PORT", help="of the first process")
    group.add_argument("--process", type=int, metavar="I", help="which one this is, from 0")
    group.add_argument("--processes", type=int, metavar="N", help="how many there are")


@contextmanager
def shared_parts(arguments: argparse.Namespace) -> Iterator["Parts | None"]:
    """The parts of a command that several processes were started for, in its `--out`; else None.

    Raises:
        DataError, InputError: for options that do not fit together, or processes that do not meet.
    """
    place = place_of(arguments)
    if place is None:
        yield None
        return
    from calibration.parts import Parts

    folder = Path(arguments.out) / FOLDER
    with Parts(folder, *place, meet=lambda: _meet(arguments.coordinator, *place)) as parts:
        yield parts


def place_of(arguments: argparse.Namespace) -> tuple[int, int] | None:
    """Which process this is, of how many; None where it is alone."""
    told = (arguments.process, arguments.processes)
    if (told[0] is None) != (told[1] is None):
        raise DataError("--process, --processes", "one of them", "given together")
    if told[0] is None:
        return _launched(arguments.coordinator)
    index, count = told
    if arguments.coordinator is None:
        raise DataError("--coordinator", "missing", "HOST:PORT, the same for all processes")
    if not 0 <= index < count:
        raise DataError("--process", index, f"a whole number from 0 to {count - 1} (--processes)")
    return index, count


def _launched(coordinator: str | None) -> tuple[int, int] | None:
    for rank, size in LAUNCHERS:
        if int(os.environ.get(size, 1)) > 1 and rank in os.environ:
            return int(os.environ[rank]), int(os.environ[size])
    if coordinator is not None:
        raise DataError("--process", "missing", "given beside --coordinator, with --processes")
    return None


def _meet(coordinator: str | None, index: int, count: int) -> None:
    """Wait for the others; where JAX is told no coordinator it looks for one itself.

    Then each goes its own way: from here on files tell them of each other, and JAX's own runtime
    would end all that are left by a trace of its C++ where one of them ends.
    """
    import jax

    if count == 1:
        return
    try:
        jax.distributed.initialize(
            coordinator,
            count,
            index,
            initialization_timeout=WAIT,
            cluster_detection_method="deactivate" if coordinator else None,
        )
        jax.distributed.shutdown()
    except (RuntimeError, ValueError) as error:
        problem = f"the {count} processes did not meet ({str(error).splitlines()[0]})"
        accepted = "each needs --coordinator HOST:PORT, a free port of the first one's machine"
        raise InputError(None, None, problem, accepted) from None
