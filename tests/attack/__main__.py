"""The command line of the attack."""

import argparse
import json
import secrets
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from .cases import SHARES, class_of
from .pool import outcomes
from .worker import run_case


def main() -> int:
    arguments = _arguments()
    if arguments.seed is not None:
        numbers = [arguments.seed]
    else:
        start = secrets.randbelow(1 << 30) if arguments.start is None else arguments.start
        print(f"--start {start} --cases {arguments.cases}", flush=True)
        numbers = [
            number
            for number in range(start, start + arguments.cases)
            if arguments.only in (None, class_of(number))
        ]
    # End the children as well.
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    began = time.monotonic()
    tried, failed, kinds = Counter(), Counter(), Counter()
    with open(arguments.report, "a", encoding="utf-8") as report:
        chosen = _until(began + arguments.seconds, numbers)
        found = outcomes(chosen, arguments.jobs) if arguments.jobs else map(run_case, chosen)
        for done, outcome in enumerate(found, 1):
            tried[outcome["class"]] += 1
            if outcome["status"] != "ok":
                failed[outcome["class"]] += 1
                kinds[_kind(outcome)] += 1
                line = json.dumps(outcome)
                print(line if arguments.seed is None else _readable(outcome), flush=True)
                report.write(line + "\n")
                report.flush()
            elif arguments.seed is not None:
                print(_readable(outcome))
            if done % 500 == 0:
                print(f"{done} of {len(numbers)}, {failed.total()} failed", file=sys.stderr)
    _summarize(tried, failed, kinds, time.monotonic() - began)
    return 1 if failed else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="how many cases")
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), help="start no case after so many seconds"
    )
    parser.add_argument("--start", type=int, help="the first number; by default a random one")
    parser.add_argument("--seed", type=int, help="run this case only, and say what it was")
    parser.add_argument("--only", choices=SHARES, help="run cases of this class only")
    jobs = "children at a time; 0 runs all cases in this process, without limits"
    parser.add_argument("--jobs", type=int, default=2, help=jobs)
    parser.add_argument(
        "--report", type=Path, default=Path("/dev/null"), help="append a line of JSON per failure"
    )
    return parser.parse_args()


def _until(end: float, numbers: Iterable[int]) -> Iterator[int]:
    """Return the numbers of the cases to start, until a time."""
    for number in numbers:
        if time.monotonic() > end:
            return
        yield number


def _kind(outcome: dict) -> str:
    """Return what failures of one cause have in common: the first words and the last place."""
    places = [line.strip() for line in outcome.get("where", "").splitlines() if "File " in line]
    return f"{outcome['what'].split(': ')[0][:70]} | {places[-1] if places else ''}"


def _readable(outcome: dict) -> str:
    return "\n".join(f"{key}: {value}" for key, value in outcome.items())


def _summarize(tried: Counter, failed: Counter, kinds: Counter, seconds: float) -> None:
    for name, count in tried.items():
        print(f"{name}: {count} cases, {failed[name]} failed")
    for kind, count in kinds.most_common(40):
        print(f"{count:6d}  {kind}")
    print(f"{tried.total()} cases in {seconds:.0f} s, {failed.total()} failed")


if __name__ == "__main__":
    sys.exit(main())
