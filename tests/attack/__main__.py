"""The command line of the attack."""

import argparse
import json
import secrets
import signal
import sys
import time
from collections import Counter
from itertools import takewhile

from .cases import LONG, SHARES, SWEEP, class_of
from .pool import outcomes
from .worker import run_case


def main() -> int:
    arguments = _arguments()
    numbers = _numbers(arguments)
    # End the children as well.
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    began = time.monotonic()
    chosen = takewhile(lambda number: time.monotonic() - began <= arguments.seconds, numbers)
    found = outcomes(chosen, arguments.jobs) if arguments.jobs else map(run_case, chosen)
    tried, failed = Counter(), Counter()
    for outcome in found:
        tried[outcome["class"]] += 1
        if arguments.seed is not None:
            print("\n".join(f"{key}: {value}" for key, value in outcome.items()))
        if outcome["status"] != "ok":
            failed[outcome["class"]] += 1
            print(json.dumps(outcome), flush=True)
    for name, count in tried.items():
        print(f"{name}: {count} cases, {failed[name]} failed")
    seconds = time.monotonic() - began
    print(f"{tried.total()} cases in {seconds:.0f} s, {failed.total()} failed")
    return 1 if failed else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description=__doc__)
    add = parser.add_argument
    add("--cases", type=int, default=1000, help="how many cases")
    add("--seconds", type=float, default=float("inf"), help="start no case after so many seconds")
    add("--start", type=int, help="the first number; by default a random one")
    add("--seed", type=int, help="run this case only, and say what it was")
    add("--only", choices=[*SHARES, *LONG], help="run cases of this class only")
    sweep = "call every function with every bad value for every parameter, or with each STEP-th"
    add("--sweep", type=int, nargs="?", const=1, metavar="STEP", help=sweep)
    jobs = "children at a time; 0 runs all cases in this process, without limits"
    add("--jobs", type=int, default=2, help=jobs)
    return parser.parse_args()


def _numbers(arguments: argparse.Namespace) -> list[int]:
    """Return the numbers of the cases to run."""
    if arguments.seed is not None:
        return [arguments.seed]
    if arguments.sweep is not None:
        from .calls import n_sweep

        return list(range(SWEEP, SWEEP + n_sweep(), arguments.sweep))
    start = secrets.randbelow(1 << 30) if arguments.start is None else arguments.start
    print(f"--start {start} --cases {arguments.cases}", flush=True)
    if arguments.only in LONG:
        first = LONG[arguments.only] + start % (1 << 40)
        return list(range(first, first + arguments.cases))
    numbers = range(start, start + arguments.cases)
    return [number for number in numbers if arguments.only in (None, class_of(number))]


if __name__ == "__main__":
    sys.exit(main())
