"""What was tuned in the commands.  Values without a stated effect were not varied."""

#: Steps are printed as lines only from this many seconds on: quick commands print none.
SECONDS_BEFORE_LINES = 3.0
#: Seconds between lines about the same step.
INTERVAL = 30.0
#: Bytes for the sizes of a surface, per triangle: 0.8 GB for 600 000 (benchmarks/large_inputs.py).
PER_TRIANGLE = 1300.0
#: Bytes for a mesh by Mmg, per element made: 1 GB for 1 million, in both processes together.
PER_ELEMENT = 1000.0
#: Bytes below which the memory is not worth a line.
WORTH_A_LINE = 1e9
#: A tolerance that looks like a length.
LOOSE = 0.1
