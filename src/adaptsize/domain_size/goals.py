"""How many elements, nodes or unknowns are requested or allowed."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from adaptsize._defaults import RELAXED_TO
from adaptsize._messages import Message
from adaptsize.domain_size.unknowns import as_bytes
from adaptsize.errors import OptionError
from adaptsize.options.sizes import BudgetOptions

#: What a mesh may have a requested number of; "dofs" are the unknowns of finite elements.
Goal: TypeAlias = Literal["elements", "nodes", "dofs"]


def goal_of(options: BudgetOptions) -> tuple[Goal, float] | None:
    """Return which number is requested, and how large; refuse several of them."""
    names: tuple[Goal, ...] = ("elements", "nodes", "dofs")
    given = [(name, value) for name in names if (value := options[name]) is not None]
    if len(given) > 1:
        raise _exclusive(given[1][0], given[0][0])
    return given[0] if given else None


def _exclusive(one: str, other: str) -> OptionError:
    text = "{} and {} exclude each other: omit one of them"
    return OptionError(Message(text, Message.name(one), Message.name(other)))


def largest_number(options: BudgetOptions) -> float:
    """Return the limit on the number of elements; refuse numbers that contradict each other."""
    elements, most = options["elements"], options["max_elements"]
    goal, memory = goal_of(options), options["max_memory"]
    if memory is not None:
        as_bytes(memory)
    if goal is not None:
        if most is not None or memory is not None:
            raise _exclusive(goal[0], "max_memory" if most is None else "max_elements")
        return np.inf if elements is None else elements
    if most is not None:
        return most
    return RELAXED_TO if memory is None else np.inf
