"""Cases that end badly on purpose, with numbers below 0: the attack must notice them."""

import os
import signal

from .cases import Failure


def run(number: int) -> str:
    """Do what the number stands for."""
    if number == -1:
        os.kill(os.getpid(), signal.SIGSEGV)
    if number == -2:
        while True:
            pass
    if number == -3:
        raise Failure("on purpose")
    if number == -4:
        bytearray(64 << 30)
    return "nothing"
