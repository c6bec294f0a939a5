"""Which statements of a copy ran in this process: see `tests.lines`. Every process loads it."""

import atexit
import json
import os

ran: set[int] = set()  # numbers of statements
ELSEWHERE = "STATEMENTS_THAT_RAN"  # a folder, where processes that a test starts say what they ran
if ELSEWHERE in os.environ:

    def _say() -> None:
        path = os.path.join(os.environ[ELSEWHERE], str(os.getpid()))
        with open(path, "w", encoding="utf-8") as file:
            json.dump(sorted(ran), file)

    atexit.register(_say)
